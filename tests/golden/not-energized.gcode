; the second line needs Y, which no capture holds
G1010 P0
G94 F6000 G01 X10
G01 Y10
