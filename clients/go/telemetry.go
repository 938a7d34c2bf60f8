package mcclient

import (
	"bytes"
	"encoding/binary"
	"fmt"
	"math"

	"github.com/vmihailenco/msgpack/v5"
)

// Samples are some consecutive cycles of every axis. Each slice has Rows × len(Axes) numbers: the axes of the first cycle, then those
// of the next.
type Samples struct {
	// Seq is the number of the first cycle; a jump from one Samples to the next means cycles lost on the way.
	Seq int64
	// T is the executor time of the first cycle, CycleS the time between two [s].
	T, CycleS float64
	Rows      int
	Axes      []int64
	// Fields has every field that the server sends by its name; the four below are among them.
	Fields map[string][]float32
	// Setpoint and Position [mm, deg], Velocity per second, Torque [N·m].
	Setpoint, Position, Velocity, Torque []float32
}

func decodeSamples(payload []byte, info *TelemetryInfo, cycleS float64) (*Samples, error) {
	seq, t, rows, err := decodeBlock(payload)
	if err != nil {
		return nil, notUnderstood("TelemetryBlock", err)
	}
	width := len(info.Axes) * len(info.Fields)
	if width == 0 || len(rows)%(4*width) != 0 {
		return nil, notUnderstood("TelemetryBlock", fmt.Errorf("%d bytes are not rows of %d numbers", len(rows), width))
	}
	samples := &Samples{Seq: seq, T: t, CycleS: cycleS, Rows: len(rows) / (4 * width), Axes: info.Axes}
	samples.Fields = make(map[string][]float32, len(info.Fields))
	count := samples.Rows * len(info.Axes)
	for index, name := range info.Fields {
		column := make([]float32, count)
		for i := range column {
			column[i] = math.Float32frombits(binary.LittleEndian.Uint32(rows[4*(i*len(info.Fields)+index):]))
		}
		samples.Fields[name] = column
	}
	samples.Setpoint, samples.Position = samples.Fields["setpoint"], samples.Fields["position"]
	samples.Velocity, samples.Torque = samples.Fields["velocity"], samples.Fields["torque"]
	return samples, nil
}

func decodeBlock(payload []byte) (seq int64, t float64, rows []byte, err error) {
	decoder := msgpack.NewDecoder(bytes.NewReader(payload))
	count, err := decoder.DecodeArrayLen()
	if err != nil {
		return 0, 0, nil, err
	}
	if count < 3 {
		return 0, 0, nil, fmt.Errorf("an array of %d elements", count)
	}
	if seq, err = decoder.DecodeInt64(); err != nil {
		return 0, 0, nil, err
	}
	if t, err = decoder.DecodeFloat64(); err != nil {
		return 0, 0, nil, err
	}
	rows, err = decoder.DecodeBytes()
	return seq, t, rows, err
}
