; G64 without a path tolerance keeps the corners: the motion stops there
G1010
G94 F6000
G01 X100
G01 Y100
G01 X0
G01 Y0
