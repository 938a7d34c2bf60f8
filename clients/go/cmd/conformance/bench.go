package main

import (
	"slices"
	"time"
)

const (
	statusCalls  = 300
	benchSeconds = 3
)

// bench measures what this SDK does on this computer: lines streamed a second, the median of a status call, and samples' messages a second.
func bench(t task) error {
	program, err := t.machine.Program(t.ctx, nil)
	if err != nil {
		return err
	}
	begun := time.Now()
	if err := program.SendLines(t.ctx, linesOf(t.args[0], 1)); err != nil {
		return err
	}
	streamed := time.Since(begun)
	count := program.Accepted()
	if err := program.Finish(t.ctx); err != nil {
		return err
	}
	var latencies []time.Duration
	for range statusCalls {
		begun := time.Now()
		if _, err := t.machine.Status(t.ctx); err != nil {
			return err
		}
		latencies = append(latencies, time.Since(begun))
	}
	slices.Sort(latencies)
	feed, err := t.machine.Samples(t.ctx)
	if err != nil {
		return err
	}
	defer feed.Close()
	frames, rows := 0, 0
	begun = time.Now()
	for samples := range feed.All(t.ctx) {
		frames++
		rows += samples.Rows
		if time.Since(begun) > benchSeconds*time.Second {
			break
		}
	}
	took := time.Since(begun).Seconds()
	say(map[string]any{
		"lines_per_s": float64(count) / streamed.Seconds(), "status_p50_ms": latencies[len(latencies)/2].Seconds() * 1e3,
		"frames_per_s": float64(frames) / took, "rows_per_s": float64(rows) / took,
	})
	return nil
}
