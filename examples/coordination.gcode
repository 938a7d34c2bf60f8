; Two ways to coordinate motions in one line: concatenation shares one time, a comma only the start.
G1010
G94 F6000
G01 X50 Y50                                                  ; a quarter arc of R50 starts here
G93 F60                                                      ; moves per minute: each lasts 1 s
G01 [5]100 [6]200 [7]0 [8]-90 G02 X100 Y100 R50              ; together: both last 1 s
G01 [5]0 [6]0 [8]0 G01 X50 Y50
G01 [5]100 [6]200 [7]0 [8]-90 F60, G02 X100 Y100 R50 F120    ; comma: 1 s and 0.5 s, the line ends at 1 s
G1011
