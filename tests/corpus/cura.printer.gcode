;FLAVOR:Marlin
;TIME:120
;Filament used: 0.1m
;Layer height: 0.2
M140 S60
M105
M190 S60
M104 S200
M105
M109 S200
M82 ;absolute extrusion mode
G28 ;Home
G1 Z15.0 F6000 ;Move the platform down 15mm
;Prime the extruder
G92 E0
G1 F200 E3
G92 E0
G92 E0
G1 F1500 E-6.5
;LAYER_COUNT:1
;LAYER:0
M107
G0 F3600 X85.5 Y80.2 Z0.3
;TYPE:SKIRT
G1 F1500 E0
G1 F1200 X86.3 Y79.4 E0.0376
G1 X90.25 Y76.1 E0.2089
G0 F3600 X91 Y77
G1 F1200 X95 Y77 E0.35
M140 S0
M106 S127
G91 ;Relative positioning
G1 E-2 F2700 ;Retract a bit
G1 E-2 Z0.2 F2400 ;Retract and raise Z
G1 X5 Y5 F3000 ;Wipe out
G90 ;Absolute positioning
G1 X0 Y200 ;Present print
M84 X Y E ;Disable all steppers but Z
M82 ;absolute extrusion mode
M104 S0
;End of Gcode
