; Y and Z are named first by later lines: the motion goes on through the joints
G1010
G94 F6000
G01 X100
G01 X200 Y0.001
G01 X300 Y0.002 Z0.001
