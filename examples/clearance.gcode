; Around a post: the flange would come too near to it (mcserver simulate … --machine examples/post-and-door.toml)
G1010
G0 T3 X460 Y0 Z500
G1 X420 Y-150 Z400 F6000
G1 X420 Y150
G1 X550 Y150
G1 X550 Y-50
G1 X480 Y-50
