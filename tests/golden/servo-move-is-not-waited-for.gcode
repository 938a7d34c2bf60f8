; X is under way while Y moves; the run ends when X has come to rest: 0.2 s of ramps and 0.8 s at 200 mm/s
G1010
G1020 X160
G94 F6000 G01 Y10
