package mcclient

import (
	"context"
	"errors"
	"fmt"
	"iter"
	"strings"
	"sync"
	"time"
	"unicode/utf8"
)

// Program is one stream of lines with modal state and axes of its own.
type Program struct {
	// ID is the program's id on the server, Axes those that it leases.
	ID   string
	Axes []int64

	machine  *Machine
	patience time.Duration
	// one call at a time sends; who has the turn may leave an exchange behind that ends later
	turn     chan struct{}
	exchange chan struct{}

	mu      sync.Mutex
	stream  *stream
	heard   time.Time
	changed chan struct{}
	stop    func()
}

// Program opens a program; nil leases every axis, starts at line 1, and stops when this client is gone.
func (m *Machine) Program(ctx context.Context, request *OpenRequest) (*Program, error) {
	if request == nil {
		request = &OpenRequest{}
	}
	return m.follow(ctx, func(ctx context.Context) (*stream, []int64, error) {
		opened, err := m.OpenProgram(ctx, *request)
		if err != nil {
			return nil, nil, err
		}
		return newStream(opened), opened.Axes, nil
	})
}

// ContinueProgram goes on with a program that has ended, such as by a restart of the server: it energizes what the program had energized, brings the
// axes to where its next line starts, and runs the lines that the journal has. Lines behind Given are to be sent where its text was not whole.
//
// show, unless it is nil, gets before that what ran, where the axes stand and where the program has them; where it fails, nothing moves.
//
// It fails with a RefusedError where something is not certain (MC450, MC592, MC593, MC594); nothing has moved then.
func (m *Machine) ContinueProgram(ctx context.Context, request ContinueRequest, show func(*Continuation) error) (*Program, error) {
	if show != nil {
		shown, err := m.Continuation(ctx, ContinuationRequest{Program: request.Program, Line: request.Line})
		if err == nil {
			err = show(shown)
		}
		if err != nil {
			return nil, err
		}
	}
	return m.follow(ctx, func(ctx context.Context) (*stream, []int64, error) {
		opened, err := m.OpenContinuation(ctx, request)
		if err != nil {
			return nil, nil, err
		}
		return continuedStream(opened), opened.Axes, nil
	})
}

func (m *Machine) follow(ctx context.Context, open func(context.Context) (*stream, []int64, error)) (*Program, error) {
	program := &Program{
		machine: m, patience: m.client.options.Patience, turn: make(chan struct{}, 1), heard: time.Now(), changed: make(chan struct{}),
	}
	if program.patience == 0 {
		program.patience = programPatience
	}
	if err := program.open(ctx, open); err != nil {
		return nil, err
	}
	stop, err := m.client.listen(ctx, &topic{
		machine: m.name,
		name:    "ack/" + program.ID,
		deliver: func(payload []byte) {
			if ack, err := decode[Ack](payload); err == nil {
				program.hear(func(s *stream) { s.acknowledged(ack) })
			}
		},
		resumed: func() { program.change(func(s *stream) { s.stale = true }) },
		ended: func(err error) {
			program.change(func(s *stream) {
				if s.failure == nil && !s.state.Ended() {
					s.failure = err
				}
			})
		},
	})
	if err != nil {
		m.drop(ctx, program.ID)
		return nil, err
	}
	program.change(func(*stream) { program.stop = stop })
	return program, nil
}

// open asks for a program. One that is opened for a caller who has gone is aborted: nobody else would give its axes back.
func (p *Program) open(ctx context.Context, ask func(context.Context) (*stream, []int64, error)) error {
	outcome := make(chan error, 1)
	go func() {
		made, axes, err := ask(context.WithoutCancel(ctx))
		if err == nil {
			p.ID, p.Axes, p.stream = made.program, axes, made
		}
		outcome <- err
	}()
	select {
	case err := <-outcome:
		return err
	case <-ctx.Done():
		go func() {
			if <-outcome == nil {
				p.machine.drop(ctx, p.ID)
			}
		}()
		return ctx.Err()
	}
}

// drop aborts a program whose caller has gone.
func (m *Machine) drop(ctx context.Context, program string) {
	ending, cancel := context.WithTimeout(context.WithoutCancel(ctx), stopLimit)
	defer cancel()
	_, _ = m.Abort(ending, program)
}

// Accepted is the number of the last line that the server has taken and journaled.
func (p *Program) Accepted() int64 { return p.look(func(s *stream) int64 { return s.accepted }) }

// Done is the number of the last line that has ended.
func (p *Program) Done() int64 { return p.look(func(s *stream) int64 { return s.done }) }

// Given is the number of the last line given to Send or SendLines.
func (p *Program) Given() int64 { return p.look(func(s *stream) int64 { return s.given() }) }

// Failure is what Finish will return, as soon as it is known: a fault, or a line that was found faulty late; nil while there is none.
func (p *Program) Failure() error {
	p.mu.Lock()
	defer p.mu.Unlock()
	return p.stream.failure
}

// State is as the server said last.
func (p *Program) State() ProgramState {
	p.mu.Lock()
	defer p.mu.Unlock()
	return p.stream.state
}

// SendLines streams lines as the server takes them, each as soon as it is there, and returns once all are accepted. A fault of a line that is found
// later is returned by Finish. Where the context is done, what has not been sent is given up; what is under way may be accepted.
//
// It fails with a RejectedError or an EndedError.
func (p *Program) SendLines(ctx context.Context, lines iter.Seq[string]) (failure error) {
	if err := p.begin(ctx); err != nil {
		return err
	}
	defer func() { p.end(failure) }()
	ctx, cancel := context.WithCancel(ctx)
	sending := newSending(ctx, p)
	defer sending.stop(cancel)
	for line := range lines {
		text, err := p.checked(line)
		if err != nil {
			return err
		}
		p.change(func(s *stream) { s.give(text) })
		if err := sending.begin(); err != nil {
			return err
		}
		if err := sending.wait(func() bool { return p.look(func(s *stream) int64 { return int64(len(s.waiting)) }) < chunkLines }); err != nil {
			return err
		}
	}
	if err := sending.wait(func() bool { return false }); err != nil {
		return err
	}
	return p.drain(ctx, false)
}

// Send sends one line and waits for the verdict on it, not for its motion; it returns the line's number.
//
// It fails with a RejectedError where the line has faults: nothing of it moves, and the program lives on.
func (p *Program) Send(ctx context.Context, line string) (number int64, failure error) {
	if err := p.begin(ctx); err != nil {
		return 0, err
	}
	defer func() { p.end(failure) }()
	text, err := p.checked(line)
	if err != nil {
		return 0, err
	}
	p.change(func(s *stream) { number = s.give(text) })
	return number, p.drain(ctx, true)
}

// Close says that no more lines will come; what is accepted runs to its end.
func (p *Program) Close(ctx context.Context) (failure error) {
	if err := p.begin(ctx); err != nil {
		if p.State().Ended() {
			return nil
		}
		return err
	}
	defer func() { p.end(failure) }()
	reply, err := p.machine.CloseProgram(ctx, CloseRequest{Program: p.ID, Last: Ptr(p.Accepted())})
	if err != nil {
		return p.meaning(ctx, err)
	}
	p.hear(func(s *stream) {
		s.numbers(s.rejections, reply.Accepted, reply.Done, 0)
		// why it has ended is not in this reply
		s.stale = s.stale || reply.State.Ended()
	})
	return nil
}

// Finish closes the program and waits until it has ended; nil: it has finished. A rejected line is returned once what is before it has run.
func (p *Program) Finish(ctx context.Context) error {
	var rejected error
	if err := p.Close(ctx); err != nil {
		if !errors.As(err, new(*RejectedError)) || p.State().Ended() {
			return err
		}
		rejected = err
		p.change(func(s *stream) { s.forgive() })
		if err := p.Close(ctx); err != nil {
			return err
		}
	}
	err := p.until(ctx, func(s *stream) bool {
		var line *RejectedError
		if errors.As(s.failure, &line) && !s.state.Ended() {
			// found after the close: the program ends there
			return false
		}
		return s.state.Ended() || s.failure != nil
	})
	if err != nil {
		return err
	}
	p.mu.Lock()
	defer p.mu.Unlock()
	if p.stream.failure != nil {
		return p.stream.failure
	}
	return rejected
}

// WaitDone waits until the line with this number has ended, or the program has finished.
func (p *Program) WaitDone(ctx context.Context, line int64) error {
	err := p.until(ctx, func(s *stream) bool { return s.done >= line || s.state.Ended() || s.failure != nil })
	if err != nil {
		return err
	}
	p.mu.Lock()
	defer p.mu.Unlock()
	if p.stream.done >= line || p.stream.state == ProgramStateFinished {
		return nil
	}
	p.stream.heard = true
	return p.stream.failure
}

// Hold stops the program along its path until Resume.
func (p *Program) Hold(ctx context.Context) error {
	_, err := p.machine.Hold(ctx, p.ID)
	return err
}

// Resume ends a hold, M00 or M01.
func (p *Program) Resume(ctx context.Context) error {
	_, err := p.machine.Resume(ctx, p.ID)
	return err
}

// Abort stops along the path and drops the rest; the program ends as aborted.
func (p *Program) Abort(ctx context.Context) error {
	_, err := p.machine.Abort(ctx, p.ID)
	return err
}

// Override sets the feed override of this program [%].
func (p *Program) Override(ctx context.Context, percent float64) error {
	_, err := p.machine.Override(ctx, OverrideRequest{Percent: percent, Program: p.ID})
	return err
}

func (p *Program) checked(line string) (string, error) {
	text := strings.TrimRight(line, "\r\n")
	limit := p.machine.Info.Limits.MaxLineLength
	length := int64(utf8.RuneCountInString(text))
	switch {
	case strings.ContainsAny(text, "\r\n"):
		return "", &Error{Code: CodeLineUnfit, Message: "a line must not hold a line end", Hint: "split the text into lines"}
	case !utf8.ValidString(text):
		return "", &Error{Code: CodeLineUnfit, Message: "the line is no UTF-8", Hint: "convert the file"}
	case limit > 0 && length > limit:
		return "", &Error{Code: CodeLineUnfit, Message: fmt.Sprintf("the line has %d characters, the server takes %d", length, limit), Hint: "break it at a command"}
	}
	return text, nil
}
