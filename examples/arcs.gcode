; Lines, arcs by radius and by centre, and a full circle: the controller reference's listing, corrected where
; the printed text has letters for digits. Feed path 17 273.5 mm.
G1010                        ; energize all axes
G94 F30000                   ; millimetres per minute: 500 mm/s
G00 X0 Y0                    ; rapid to the origin
G01 V1000                    ; V is Y, incremental
G02 X1000 Y2000 R1000        ; clockwise arc by its radius
G01 U1000
G02 X3000 Y1000 R1000
G01 V-1000
G02 X2000 Y-1000 I-1000 J0   ; clockwise arc by its centre, an increment from the start point
G01 U-1000
G02 X0 Y0 I0 J1000
G01 U500 V500
G02 X500 Y500 I1000 J0       ; start and end are one point: a full circle about (1500, 500)
G04 P2.5                     ; dwell for 2.5 s
G1011                        ; de-energize all axes
