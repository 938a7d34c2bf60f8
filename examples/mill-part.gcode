; A plate of 60 x 40 mm on the mill of examples/mill.toml, from its corner to the last thread.
; Home first: mcctl home --all. At each M6 the machine waits for the tool; resume goes on.
G21 G17 G90 G94 G40 G80 G64 P0.01

; the corner, by a probe whose ball has a radius of 2 mm
T1 M6
G43 H1
G53 G0 Z-1
G53 G0 X110 Y90
G38.2 Z-120 F300
G1 Z#5063 F100                 ; back to where it touched
G10 L20 P1 Z0
G91 G0 Z5
G53 G0 X90
G0 Z-10
G38.2 X30 F300
G90 G1 X#5061 F100
G10 L20 P1 X-2
G91 G0 X-5
G53 G0 Y70
G0 X15
G38.2 Y30 F300
G90 G1 Y#5062 F100
G10 L20 P1 Y-2
G91 G0 Y-5
G90 G53 G0 Z-1

; the contour, 3 mm deep, left of the path
T2 M6
G43 H2
S3000 M3
G0 X-15 Y-15
Z2
G1 Z-3 F300
G41 D2 X0 F600
Y34
G2 X6 Y40 I6
G1 X54
G2 X60 Y34 J-6
G1 Y6
G2 X54 Y0 I-6
G1 X-15
G40 X-20 Y-15
G0 Z20
M5

; four holes for M6
T3 M6
G43 H3
S2000 M3
G0 Z5
G98 G83 X10 Y10 Z-16 R2 Q5 F200
X50
Y30
X10
G80
G0 Z20
M5

; and their threads
T4 M6
G43 H4
S300 M3
G0 Z5
G98 G84 X10 Y10 Z-12 R5 F300
X50
Y30
X10
G80
M5
G53 G0 Z-1
G53 G0 X5 Y290
M30
