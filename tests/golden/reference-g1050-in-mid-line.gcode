; tool 3 by inverse kinematics and axis 8 directly, with one start and one end
G1010
G93 F60
G01 T3 X-159 Y-417.5 Z104.5 G1050 G01 [8]-60
