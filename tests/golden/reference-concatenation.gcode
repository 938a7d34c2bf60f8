; both motions last one second: the first sets the time
G1010
G00 X50 Y50
G93
F60
G01 [5]100 [6]200 [7]0 [8]-90 G02 X100 Y100 R50
