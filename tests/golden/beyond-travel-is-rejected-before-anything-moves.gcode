G1010
G94 F6000
G01 X100
; the arc's top leaves the travel though both ends are inside
G00 X0 Y4900
G02 X400 Y4900 R200
