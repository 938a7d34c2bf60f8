; A periodic gait of four legs, for the built-in machine robot-dog: each line lasts 1 s.
; The first command of a line sets its time; the arcs lift two feet while the lines push with the other two.
G1010
G93 F60
G01 T3 X-159 Y-400 Z800 G01 T12 X159 Y-400 Z-100 G02 T6 Y-400 Z0 R500 G02 T9 Y-400 Z-800 R500
G01 T6 X159 Y-400 Z800 G01 T9 X-159 Y-400 Z-100 G02 T3 Y-400 Z0 R500 G02 T12 Y-400 Z-800 R500
G01 T3 X-159 Y-400 Z800 G01 T12 X159 Y-400 Z-100 G02 T6 Y-400 Z0 R500 G02 T9 Y-400 Z-800 R500
G01 T6 X159 Y-400 Z800 G01 T9 X-159 Y-400 Z-100 G02 T3 Y-400 Z0 R500 G02 T12 Y-400 Z-800 R500
G1050
G1011
