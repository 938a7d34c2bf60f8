; X takes 0.7 s, Y 0.2 s: not coordinated, exact stop, no requested time
G00 X100 Y10
G00 X0 Y0
