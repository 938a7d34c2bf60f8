; a quarter arc of 40 mm at 100 mm/s asks 250 mm/s²: the line before and after are met at full speed
G1010
G94 F6000
G01 X100
G03 X140 Y40 R40
G01 Y140
