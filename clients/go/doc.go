// Package mcclient is a client of the open motion server, through its gateway (docs/gateway.md).
//
// A [Client] is one connection, which is made anew when it breaks. A [Machine] is one motion server behind the gateway, and a
// [Program] a stream of G-code lines with a lease on axes: each line runs exactly once, whatever happens to the connection.
//
// Positions are in mm (linear axes) or deg (rotary axes), velocities in mm/s or deg/s, torques in N·m, times in seconds since the
// executor's start, percentages in %.
//
// Every method that waits takes a context. All types may be used by several goroutines at once, but a program takes lines from one
// call at a time; others wait.
package mcclient
