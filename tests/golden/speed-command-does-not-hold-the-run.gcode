; 600 rpm of a motor that moves 10 mm a turn are 100 mm/s
G1010
G1030 X600
G94 F6000 G01 Y10
G04 P0.5
