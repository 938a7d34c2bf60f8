; F alone, in a line, and as moves per minute; G20 reads it in inches
G1010
G94
F3000
G09 G01 X50
G09 G01 X100 F6000
G93 F120
G09 G01 X150
G94 G20 F60
G09 G01 U1
