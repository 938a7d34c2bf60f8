; the axis stands at 25 mm
G1010
G91
G94 F3000
G01 X10
G01 X-5
