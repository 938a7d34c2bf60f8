package mcclient

import (
	"context"
	"fmt"
	"sync"
	"time"
)

const (
	targetsCount = 100 * time.Millisecond
	// The server acknowledges targets within 50 ms; one that has not for so long beyond what they count is gone [s].
	unansweredFor = 0.5
)

// Targets say where axes, or a tool, are to be. At least one of Positions and Velocities is given: a row for each point, in it a number for each axis.
type Targets struct {
	// Positions are in mm and deg, of one row without Times; the axes come to rest there, unless the next ones lead on.
	Positions [][]float64
	// Velocities are in mm/s and deg/s: with Positions, the axes pass there at them; alone, they go on at them.
	Velocities [][]float64
	// Times of the points from now, ascending.
	Times []time.Duration
	// Counts is as of Machine.Servo; 0: as there.
	Counts time.Duration
	// Tool is the number of a tool, whose poses X Y Z A B C and twists the rows are then (X Y Z of one without orientation); nil: rows of axes.
	Tool *int64
	// InToolFrame: a tool's Velocities are along and about its own axes, else the base's; poses are in the base's.
	InToolFrame bool
}

// Row is one point of Targets.
func Row(values ...float64) [][]float64 { return [][]float64{values} }

// Servo is axes that follow what is sent, until Close or Abort (docs/servo.md).
type Servo struct {
	program *Program
	counts  time.Duration
	begun   time.Time
	mu      sync.Mutex
	seq     int64
}

// Servo leases axes (of the zero value all), energizes them and lets them follow. It fails with a RefusedError (MC512) where one of them is leased.
// counts is how long each message counts, up to 10 s: without a newer one by then the axes stop, and the program ends. 0: 0.1 s.
func (m *Machine) Servo(ctx context.Context, request ServoRequest, counts time.Duration) (*Servo, error) {
	program, err := m.follow(ctx, func(ctx context.Context) (*stream, []int64, error) {
		opened, err := m.OpenServo(ctx, request)
		if err != nil {
			return nil, nil, err
		}
		return servoStream(opened), opened.Axes, nil
	})
	if err != nil {
		return nil, err
	}
	if counts == 0 {
		counts = targetsCount
	}
	return &Servo{program: program, counts: counts, begun: time.Now()}, nil
}

// servoStream is that of a program that gets no lines.
func servoStream(opened *ServoReply) *stream {
	return newStream(&OpenReply{Program: opened.Program, State: ProgramStateRunning, Expected: 1})
}

// ID of the program that follows.
func (s *Servo) ID() string { return s.program.ID }

// Axes that follow; rows of targets have a number for each, in this order.
func (s *Servo) Axes() []int64 { return s.program.Axes }

// State is as the server said last.
func (s *Servo) State() ProgramState { return s.program.State() }

// Failure is what Send and Close will return, as soon as it is known; nil while there is none.
func (s *Servo) Failure() error { return s.program.Failure() }

// Send sends targets, which replace those before, and waits for nothing: what a connection that is away would take is lost, for the next ones
// are newer.
//
// It fails with an EndedError once the program has ended: nothing came in time, somebody stopped it, or it was closed. It fails with an
// UnreachableError (MC530) where the server has not answered for as long as targets count, and 0.5 s.
func (s *Servo) Send(targets Targets) error {
	if targets.Counts == 0 {
		targets.Counts = s.counts
	}
	s.mu.Lock()
	defer s.mu.Unlock()
	now := time.Since(s.begun).Seconds()
	s.program.mu.Lock()
	err := s.program.stream.targets(now, targets.Counts.Seconds())
	s.program.mu.Unlock()
	if err != nil {
		return err
	}
	s.seq++
	return s.program.machine.client.put(map[string]any{
		"op": "targets", "machine": s.program.machine.name, "program": s.program.ID,
		"message": targets.message(s.seq, now),
	})
}

// targets sees whether targets can be sent at a time of the sender's clock, which count for some seconds.
func (s *stream) targets(now, counts float64) error {
	if err := s.open(); err != nil {
		return err
	}
	if s.sentAt != nil {
		// a sender that stood still for longer has not listened meanwhile
		s.silent += min(now-*s.sentAt, unansweredFor)
	}
	s.sentAt = &now
	if s.silent > counts+unansweredFor {
		return unreachable(CodeNobodyAnswers, fmt.Sprintf("the server has not answered for %.1f s", s.silent),
			"where it is gone the axes have stopped: once it is there, open servo mode anew")
	}
	return nil
}

// message is StreamTargets.
func (t *Targets) message(seq int64, sent float64) []any {
	made := []any{seq, sent, t.Counts.Seconds(), t.Positions, t.Velocities, nil, t.Tool, "base"}
	if t.InToolFrame {
		made[7] = "tool"
	}
	if t.Times != nil {
		times := make([]float64, len(t.Times))
		for index, each := range t.Times {
			times[index] = each.Seconds()
		}
		made[5] = times
	}
	return made
}

// Status asks for the program; its Servo counts what was late, lost or dropped.
func (s *Servo) Status(ctx context.Context) (*ProgramStatus, error) {
	programs, err := s.program.machine.Programs(ctx, ProgramsRequest{Program: s.program.ID})
	if err != nil {
		return nil, err
	}
	return &programs[0], nil
}

// Close lets the axes go on to the last targets, and returns once they stand there. It fails as the program ended otherwise.
func (s *Servo) Close(ctx context.Context) error { return s.program.Finish(ctx) }

// Abort stops the axes within their limits now.
func (s *Servo) Abort(ctx context.Context) error { return s.program.Abort(ctx) }
