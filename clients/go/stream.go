package mcclient

import (
	"errors"
	"fmt"
	"slices"
)

const (
	chunkLines = 1000
	chunkBytes = 64 * 1024
)

// stream is the numbering of one program's lines: a state machine without I/O or clock, for a client that has one message under way.
//
// The server takes line n only after line n - 1, acknowledges a repeat and never runs it again. So whatever is not known to be accepted
// may be sent again, and must be until it is: nothing is lost and nothing runs twice (docs/wire/lines.md).
type stream struct {
	program  string
	accepted int64
	done     int64
	credit   int64
	state    ProgramState
	failure  error
	// WaitDone has returned the failure: lines given from now on are given with knowledge of it
	heard bool
	// lines given that are not known to be accepted: accepted + 1, accepted + 2, …
	waiting []string
	// of these, so many are in the message under way
	underWay int
	// rejections of lines that are known. Lines go out with this count, and the server takes none of before a rejection; what it says with a
	// smaller one is older than what is known.
	rejections int64
	// an acknowledgement could not be placed: the server has to be asked
	stale bool
	// lines were given up while it was not known whether they had arrived: the server's number is the right one
	adrift     bool
	chunkLines int
	// when targets were sent last since the server was heard, by the sender's clock; nil: none were
	sentAt *float64
	// how long the server has been silent up to then [s]
	silent float64
}

func newStream(opened *OpenReply) *stream {
	return &stream{
		program:    opened.Program,
		accepted:   opened.Expected - 1,
		done:       opened.Expected - 1,
		credit:     opened.Credit,
		state:      opened.State,
		chunkLines: chunkLines,
	}
}

// continuedStream is that of a program that goes on: lines that the server had already are not done.
func continuedStream(r *ContinueReply) *stream {
	made := newStream(&OpenReply{Program: r.Program, State: r.State, Expected: r.Expected, Credit: r.Credit})
	made.done = r.Line - 1
	return made
}

// given is the number of the last line given.
func (s *stream) given() int64 { return s.accepted + int64(len(s.waiting)) }

// give appends a line and returns its number.
func (s *stream) give(line string) int64 {
	s.waiting = append(s.waiting, line)
	return s.given()
}

// forgive clears a rejection that the program outlives, once the application has heard of it and of nothing less: lines that were given in
// ignorance of it would take other numbers.
func (s *stream) forgive() {
	var rejected *RejectedError
	if errors.As(s.failure, &rejected) && !s.state.Ended() {
		s.failure, s.heard = nil, false
	}
}

// next returns the message to send now, within the credit; nil where nothing waits, or one is under way.
func (s *stream) next() (first int64, lines []string) {
	if s.underWay > 0 || s.failure != nil || s.state.Ended() {
		return 0, nil
	}
	count := min(len(s.waiting), int(max(0, s.credit)), s.chunkLines)
	size := 0
	for index := range count {
		size += len(s.waiting[index])
		if size > chunkBytes && index > 0 {
			count = index
			break
		}
	}
	if count == 0 {
		return 0, nil
	}
	s.underWay = count
	// a copy: the message may be sent again after these lines have been given up
	return s.accepted + 1, slices.Clone(s.waiting[:count])
}

// answered takes the reply to the message under way.
func (s *stream) answered(reply *SubmitReply) {
	s.underWay = 0
	// of a rejection that is not heard of the reply does not say which line it is
	s.stale = s.stale || reply.Rejections > s.rejections
	s.numbers(reply.Rejections, reply.Accepted, reply.Done, reply.Credit)
	s.leftOver()
}

// refused takes an error reply to the message under way. What it does not mean for the stream itself is returned.
func (s *stream) refused(refusal *RefusedError) error {
	sent := s.underWay
	s.underWay = 0
	cause := refusal.Cause
	s.done = max(s.done, whole(cause.Details["done"], 0))
	rejections := whole(cause.Details["rejections"], s.rejections)
	accepted := whole(cause.Details["accepted"], s.accepted)
	if len(cause.Diagnostics) > 0 {
		s.rejection(rejections, whole(cause.Details["expected"], accepted+1), cause.Diagnostics)
	}
	s.numbers(rejections, accepted, s.done, whole(cause.Details["credit"], s.credit))
	switch {
	case len(cause.Diagnostics) > 0:
		// its line is given up, now or when an acknowledgement said so before
	case cause.Code == "MC505", cause.Code == "MC503":
		// a line before was rejected, which an acknowledgement says or has said; of a program of an earlier
		// start the server tells how far it came when it is asked
		if s.failure == nil {
			s.stale = true
		}
	case cause.Code == "MC510":
		if state, found := cause.Details["state"].(string); found && ProgramState(state).Ended() {
			reason, _ := cause.Details["reason"].(string)
			s.ended(ProgramState(state), nil, nil, reason)
		}
		if s.failure == nil {
			s.failure = s.closed()
		}
	default:
		// such as MC519: whether the lines will be taken is not said
		s.underWay = sent
		return refusal
	}
	return nil
}

// acknowledged takes an Ack, whenever one comes.
func (s *stream) acknowledged(ack *Ack) {
	if ack.Program != s.program {
		return
	}
	s.sentAt, s.silent = nil, 0
	s.report(ack)
	if s.isOld(ack) {
		return
	}
	s.numbers(ack.Rejections, ack.Accepted, ack.Done, ack.Credit)
	s.enter(ack.State, ack.Fault, ack.Diagnostics, ack.Reason)
	s.leftOver()
}

// asked takes what the server says when it is asked; nil: it knows no such program. Nothing is under way any more.
func (s *stream) asked(status *ProgramStatus) {
	s.underWay, s.stale = 0, false
	if status == nil {
		s.unknown()
		return
	}
	ack := &Ack{
		Program: status.Program, Accepted: status.Accepted, Done: status.Done, Credit: status.Credit, State: status.State, Rejected: status.Rejected,
		Diagnostics: status.Diagnostics, Fault: status.Fault, Rejections: status.Rejections, Reason: status.Reason,
	}
	s.report(ack)
	if s.isOld(ack) {
		return
	}
	if s.adrift && status.Accepted > s.accepted {
		s.accepted, s.waiting = status.Accepted, nil
	}
	s.adrift = false
	s.acknowledged(ack)
	if status.Rejections == s.rejections && status.Accepted < s.accepted && s.failure == nil {
		// lines that were acknowledged and are not there any more: nothing that this client could send again
		s.failure = &EndedError{
			Cause: &Error{Code: CodeNotUnderstood, Message: fmt.Sprintf("the server has lines through %d, and had acknowledged %d", status.Accepted, s.accepted), Hint: "abort the program"},
			State: s.state, Accepted: status.Accepted, Done: s.done,
		}
	}
}

// numbers takes how far the program is, unless a line has been rejected since, or one that is not heard of.
func (s *stream) numbers(rejections, accepted, done, credit int64) {
	// older than what is known, or about lines that were never given
	if rejections != s.rejections || accepted < s.accepted || accepted > s.given() {
		return
	}
	if accepted > s.accepted {
		count := int(accepted - s.accepted)
		s.waiting = s.waiting[count:]
		s.underWay = max(0, s.underWay-count)
		s.accepted = accepted
	}
	s.done = max(s.done, done)
	s.credit = credit
}

// report takes the rejection that an acknowledgement or a status tells of, if it is not known yet.
func (s *stream) report(ack *Ack) {
	if ack.Rejections <= s.rejections {
		return
	}
	rejected := ack.Rejected
	if rejected == 0 {
		rejected = ack.Accepted + 1
	}
	s.rejection(ack.Rejections, rejected, ack.Diagnostics)
	if s.adrift {
		// of the lines that were given up on their way these have arrived
		s.accepted, s.waiting, s.adrift = ack.Accepted, nil, false
	}
}

// isOld tells whether a report is from before a rejection that is known; that a program has ended is never too old.
func (s *stream) isOld(ack *Ack) bool { return ack.Rejections < s.rejections && !ack.State.Ended() }

// rejection gives up a line that was found faulty, and what follows, where it is not given up yet.
func (s *stream) rejection(rejections, line int64, diagnostics []Diagnostic) {
	if rejections <= s.rejections {
		return
	}
	s.rejections = rejections
	lost := line <= s.given()
	s.cut(line)
	// what is before it is accepted
	s.numbers(rejections, line-1, s.done, s.credit)
	if lost && s.failure == nil {
		s.failure = s.faulty(line, diagnostics)
	}
}

// cut gives up a line and all behind it: it is the next number.
func (s *stream) cut(line int64) {
	keep := max(0, line-1-s.accepted)
	s.waiting = s.waiting[:min(keep, int64(len(s.waiting)))]
	s.underWay = min(s.underWay, len(s.waiting))
	s.accepted = min(s.accepted, line-1)
}

func (s *stream) enter(state ProgramState, fault *Fault, diagnostics []Diagnostic, reason string) {
	if s.state.Ended() {
		return
	}
	if state.Ended() {
		s.ended(state, fault, diagnostics, reason)
		return
	}
	s.state = state
}

func (s *stream) ended(state ProgramState, fault *Fault, diagnostics []Diagnostic, reason string) {
	if s.state.Ended() {
		return
	}
	s.state = state
	if reason != "" {
		reason = " (" + reason + ")"
	}
	cause := &Error{Code: CodeAborted, Message: fmt.Sprintf("the program was aborted%s; lines through %d are done", reason, s.done), Hint: "once the machine is clear, open another one"}
	switch {
	case state == ProgramStateFinished:
		return
	case state == ProgramStateRejected:
		s.failure = s.faulty(s.accepted+1, diagnostics)
		return
	case state == ProgramStateInterrupted:
		cause = &Error{Code: CodeInterrupted, Message: fmt.Sprintf("the server that ran the program went away; lines through %d are done, line %d may have begun", s.done, s.done+1), Hint: fmt.Sprintf("Machine.ContinueProgram with Program %q goes on", s.program)}
	case fault != nil:
		cause = &Error{Code: fault.Code, Message: fault.Message, Hint: fault.Hint}
	case state == ProgramStateFaulted:
		cause = &Error{Code: "MC400", Message: "a fault of the machine ended the program", Hint: "see the machine's faults"}
	}
	s.failure = &EndedError{Cause: cause, State: state, Fault: fault, Accepted: s.accepted, Done: s.done}
}

// abandon gives up the lines that wait. Those under way may arrive all the same.
func (s *stream) abandon() {
	if s.underWay > 0 {
		s.adrift, s.stale = true, true
	}
	s.waiting, s.underWay = nil, 0
}

// unknown: the server knows no such program, so that it was another start of it that ran the program.
func (s *stream) unknown() { s.ended(ProgramStateInterrupted, nil, nil, "") }

// leftOver raises that lines wait for a program that has finished without them.
func (s *stream) leftOver() {
	if s.state == ProgramStateFinished && s.failure == nil && len(s.waiting) > 0 {
		s.failure = s.closed()
		s.waiting = nil
	}
}

// open returns why nothing is taken any more; nil: something is.
func (s *stream) open() error {
	if s.failure == nil && s.state.Ended() {
		return s.closed()
	}
	return s.failure
}

func (s *stream) closed() error {
	return &EndedError{
		Cause: &Error{Code: CodeProgramClosed, Message: fmt.Sprintf("the program takes no more lines: it is %s", s.state), Hint: "open another one"},
		State: s.state, Accepted: s.accepted, Done: s.done,
	}
}

func (s *stream) faulty(line int64, diagnostics []Diagnostic) error {
	first := Diagnostic{Code: "MC100", Message: fmt.Sprintf("line %d was rejected", line), Line: line}
	if len(diagnostics) > 0 {
		first = diagnostics[0]
	}
	return &RejectedError{
		Cause: &Error{Code: first.Code, Message: first.Message, Hint: first.Hint, Diagnostics: diagnostics},
		Line:  line, Column: first.Column, Accepted: s.accepted, Done: s.done,
	}
}

// whole reads a number of an error's details.
func whole(value any, otherwise int64) int64 {
	switch number := value.(type) {
	case int8:
		return int64(number)
	case int16:
		return int64(number)
	case int32:
		return int64(number)
	case int64:
		return number
	case uint8:
		return int64(number)
	case uint16:
		return int64(number)
	case uint32:
		return int64(number)
	case uint64:
		return int64(number)
	}
	return otherwise
}

// Ended tells whether a program in this state is over.
func (s ProgramState) Ended() bool {
	switch s {
	case ProgramStateFinished, ProgramStateAborted, ProgramStateRejected, ProgramStateFaulted, ProgramStateInterrupted:
		return true
	}
	return false
}
