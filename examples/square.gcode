; A 100 mm square twice: stopping exactly at each corner, then blending as far as the machine allows.
G1010
G94 F6000
G61                 ; exact stop, until G64
G01 X100
G01 Y100
G01 X0
G01 Y0
G64                 ; no stop between lines; the machine's path tolerance says how far a corner is rounded
G01 X100
G01 Y100
G01 X0
G01 Y0
G1011
