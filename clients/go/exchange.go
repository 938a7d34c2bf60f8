package mcclient

import (
	"context"
	"errors"
	"fmt"
	"time"
)

// without a word for so long, the server is asked
const doubtPeriod = 2 * time.Second

// between two questions to a server that is away
const askPause = 250 * time.Millisecond

// begin waits for its turn and returns what keeps the program from taking lines.
func (p *Program) begin(ctx context.Context) error {
	select {
	case p.turn <- struct{}{}:
	case <-ctx.Done():
		return ctx.Err()
	}
	err := p.settle(ctx)
	if err != nil {
		p.end(err)
	}
	return err
}

// settle asks where a call that was given up has left the numbers.
func (p *Program) settle(ctx context.Context) error {
	for p.look(func(s *stream) int64 { return asNumber(s.adrift) }) > 0 {
		if err := p.ask(ctx, nil); err != nil {
			return err
		}
	}
	p.mu.Lock()
	defer p.mu.Unlock()
	if p.stream.heard {
		p.stream.forgive()
	}
	return p.stream.open()
}

// end gives up the turn, and the lines that are not accepted: the application knows by the failure and by Accepted where it stands.
func (p *Program) end(failure error) {
	left := p.exchange
	p.exchange = nil
	finish := func() {
		p.change(func(s *stream) {
			s.abandon()
			if failure != nil && errors.Is(failure, s.failure) {
				s.forgive()
			}
		})
		<-p.turn
	}
	if left == nil {
		finish()
		return
	}
	// cancelled while lines were under way: whether they are taken shows when their reply comes
	go func() {
		<-left
		finish()
	}()
}

// sending drains a program's lines beside whoever gives them, who may take as long for the next one as he likes.
type sending struct {
	ctx     context.Context
	program *Program
	outcome chan error
	busy    bool
}

func newSending(ctx context.Context, program *Program) *sending {
	return &sending{ctx: ctx, program: program, outcome: make(chan error, 1)}
}

// begin sees to it that what waits is sent.
func (s *sending) begin() error {
	if s.busy {
		select {
		case err := <-s.outcome:
			s.busy = false
			if err != nil {
				return err
			}
		default:
			return nil
		}
	}
	s.busy = true
	go func() { s.outcome <- s.program.drain(s.ctx, false) }()
	return nil
}

// wait returns once the condition holds, or nothing is sent any more.
func (s *sending) wait(holds func() bool) error {
	for s.busy {
		s.program.mu.Lock()
		changed := s.program.changed
		s.program.mu.Unlock()
		if holds() {
			return nil
		}
		select {
		case err := <-s.outcome:
			s.busy = false
			return err
		case <-changed:
		}
	}
	return nil
}

// stop ends what is still sent.
func (s *sending) stop(cancel context.CancelFunc) {
	cancel()
	if s.busy {
		<-s.outcome
		s.busy = false
	}
}

// drain sends what waits until all of it is accepted.
func (p *Program) drain(ctx context.Context, judge bool) error {
	for {
		p.mu.Lock()
		first, lines := p.stream.next()
		rejections := p.stream.rejections
		failure, left := p.stream.failure, len(p.stream.waiting)
		p.mu.Unlock()
		switch {
		case failure != nil:
			return failure
		case left == 0:
			return nil
		case lines == nil:
			// lines whose fate is not known are asked for before anything else is sent
			ready := func(s *stream) bool {
				return s.underWay == 0 && s.credit > 0 || s.failure != nil || len(s.waiting) == 0
			}
			if err := p.until(ctx, ready); err != nil {
				return err
			}
		default:
			if err := p.submit(ctx, &SubmitRequest{Program: p.ID, First: first, Lines: lines, Judge: &judge, Rejections: &rejections}); err != nil {
				return err
			}
		}
	}
}

// submit sends one message and takes its reply. When the context is done the exchange goes on without the caller.
func (p *Program) submit(ctx context.Context, message *SubmitRequest) error {
	outcome := make(chan error, 1)
	finished := make(chan struct{})
	go func() {
		defer close(finished)
		outcome <- p.carryOut(context.WithoutCancel(ctx), message)
	}()
	select {
	case <-ctx.Done():
		p.exchange = finished
		return ctx.Err()
	case err := <-outcome:
		if errors.As(err, new(*UnreachableError)) && Code(err) != CodeClientClosed {
			// whether the lines have arrived is not known
			return p.ask(ctx, err)
		}
		if err != nil {
			return err
		}
	}
	if p.look(func(s *stream) int64 { return asNumber(s.stale) }) > 0 {
		return p.ask(ctx, nil)
	}
	return nil
}

func (p *Program) carryOut(ctx context.Context, message *SubmitRequest) error {
	reply, err := p.machine.SubmitLines(ctx, *message)
	var refused *RefusedError
	if err == nil {
		p.hear(func(s *stream) { s.answered(reply) })
	} else if errors.As(err, &refused) {
		p.hear(func(s *stream) { err = s.refused(refused) })
	}
	return err
}

// until waits for a condition; after a silence, or where something does not fit, the server is asked.
func (p *Program) until(ctx context.Context, holds func(*stream) bool) error {
	for {
		p.mu.Lock()
		if holds(p.stream) {
			p.mu.Unlock()
			return nil
		}
		changed, stale := p.changed, p.stream.stale
		p.mu.Unlock()
		if stale {
			if err := p.ask(ctx, nil); err != nil {
				return err
			}
			continue
		}
		timer := time.NewTimer(doubtPeriod)
		select {
		case <-ctx.Done():
			timer.Stop()
			return ctx.Err()
		case <-changed:
		case <-timer.C:
			if err := p.ask(ctx, nil); err != nil {
				return err
			}
		}
		timer.Stop()
	}
}

// ask asks what the server has; while it is away, until the client's patience is over.
func (p *Program) ask(ctx context.Context, away error) error {
	programs, err := p.machine.Programs(ctx, ProgramsRequest{Program: p.ID})
	if Code(err) == "MC503" {
		p.hear(func(s *stream) { s.asked(nil) })
		return nil
	}
	if errors.As(err, new(*UnreachableError)) && Code(err) != CodeClientClosed {
		p.mu.Lock()
		silence, accepted, done := time.Since(p.heard), p.stream.accepted, p.stream.done
		p.stream.stale = true
		p.mu.Unlock()
		if silence < p.patience {
			return sleep(ctx, askPause)
		}
		return unreachable(Code(err), fmt.Sprintf("%v; of program %s lines through %d were accepted and through %d done", errors.Join(away, err), p.ID, accepted, done), "once the server is back, Programs tells how far it came")
	}
	if err != nil {
		return err
	}
	p.hear(func(s *stream) {
		for i := range programs {
			if programs[i].Program == p.ID {
				s.asked(&programs[i])
				return
			}
		}
		s.asked(nil)
	})
	return nil
}

// meaning asks why a call about the program was refused, where the program's end is the likely reason.
func (p *Program) meaning(ctx context.Context, err error) error {
	switch Code(err) {
	case "MC503", "MC505", "MC510", CodeNobodyAnswers, CodeNoAnswer:
		_ = p.ask(ctx, err)
		p.mu.Lock()
		defer p.mu.Unlock()
		if p.stream.failure != nil {
			return p.stream.failure
		}
	}
	return err
}

// hear changes the stream by what the server says.
func (p *Program) hear(apply func(*stream)) {
	p.change(func(s *stream) {
		apply(s)
		p.heard = time.Now()
	})
}

func (p *Program) change(apply func(*stream)) {
	p.mu.Lock()
	defer p.mu.Unlock()
	apply(p.stream)
	close(p.changed)
	p.changed = make(chan struct{})
	if p.stop != nil && p.stream.state.Ended() {
		// nothing more will be said of it; not from here, as it writes
		go p.stop()
		p.stop = nil
	}
}

func (p *Program) look(at func(*stream) int64) int64 {
	p.mu.Lock()
	defer p.mu.Unlock()
	return at(p.stream)
}

func sleep(ctx context.Context, pause time.Duration) error {
	timer := time.NewTimer(pause)
	defer timer.Stop()
	select {
	case <-ctx.Done():
		return ctx.Err()
	case <-timer.C:
		return nil
	}
}

func asNumber(holds bool) int64 {
	if holds {
		return 1
	}
	return 0
}
