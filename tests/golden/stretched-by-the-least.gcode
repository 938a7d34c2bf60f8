; 100 mm from rest to rest cannot be had under 0.632 s at 1000 mm/s², nor under 0.7 s at 200 mm/s
G1010
G93 F600
G01 X100
