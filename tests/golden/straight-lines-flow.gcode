; no stop and no slowing between lines that go on in one direction, nor where F falls to what is allowed
G1010
G94 F6000
G01 X50
G01 X100
G01 X150
G01 X200 F3000
G01 X250
