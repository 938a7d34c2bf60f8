; Two turns of a helix, written both ways: one command with Z, and a circle concatenated with a line.
G1010 P0                             ; energize the three axes, one by one
G1010 P1
G1010 P2
G01 X0 Y0 Z0 F30000
G03 X0 Y0 Z2000 I1000 J0 P2          ; its own length sets the time: 25.449 s and ramps
G01 Z0
G03 X0 Y0 I1000 J0 P2 G01 Z2000      ; the circle's length sets the time: 25.133 s and ramps
G01 Z0
G1011
