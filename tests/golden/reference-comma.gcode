; they start together; the arc takes half a second, the lines one: the line ends with the last
G1010
G00 X50 Y50
G93
G01 [5]100 [6]200 [7]0 [8]-90 F60, G02 X100 Y100 R50 F120
G01 X0
