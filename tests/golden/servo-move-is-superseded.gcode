; at 0.5 s X has passed 80 mm at 200 mm/s: it stops within 20 mm, and the line counts from there
G1010
G1020 X160
G04 P0.5
G94 F6000 G01 X200
