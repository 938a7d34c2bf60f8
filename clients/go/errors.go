package mcclient

import (
	"errors"
	"fmt"
)

// Codes that the client itself gives; all others are the server's (docs/wire/errors.md, docs/diagnostics.md).
const (
	CodeNobodyAnswers = "MC530"
	CodeWhichMachine  = "MC531"
	CodeNoAnswer      = "MC532"
	CodeNotUnderstood = "MC533"
	CodeInterrupted   = "MC534"
	CodeAborted       = "MC535"
	CodeProgramClosed = "MC536"
	CodeMisconfigured = "MC537"
	CodeLineUnfit     = "MC538"
	CodeClientClosed  = "MC539"
)

// Error is what every error of this package holds: a stable code such as MC505, a sentence, and the remedy.
// errors.As finds it in each of the other types.
type Error struct {
	Code        string
	Message     string
	Hint        string
	Details     map[string]any
	Diagnostics []Diagnostic
}

func (e *Error) Error() string {
	if e.Hint == "" {
		return fmt.Sprintf("%s: %s", e.Code, e.Message)
	}
	return fmt.Sprintf("%s: %s (%s)", e.Code, e.Message, e.Hint)
}

// RefusedError is the server's refusal of a request; nothing has changed.
type RefusedError struct{ Cause *Error }

// UnreachableError says that nobody answers: no gateway, no machine, no reply in time.
type UnreachableError struct{ Cause *Error }

// RejectedError names a line with faults; nothing of it moves, and the program lives on unless it was closed.
type RejectedError struct {
	Cause *Error
	// Line is the program's line, Column where its first fault begins (code points from 1).
	Line, Column int64
	// Accepted and Done are numbers of lines, as in Program.
	Accepted, Done int64
}

// EndedError says that a program has ended otherwise than finished, or takes no more lines.
type EndedError struct {
	Cause *Error
	// State is how it stands: aborted, faulted, interrupted, or finished where lines were left over.
	State ProgramState
	// Fault is what stopped it, nil where nothing of the machine did.
	Fault *Fault
	// Accepted and Done are numbers of lines: those through Done have ended, the one after it may have begun.
	Accepted, Done int64
}

func (e *RefusedError) Error() string     { return e.Cause.Error() }
func (e *UnreachableError) Error() string { return e.Cause.Error() }
func (e *RejectedError) Error() string {
	return fmt.Sprintf("line %d, column %d: %s", e.Line, e.Column, e.Cause.Error())
}
func (e *EndedError) Error() string { return e.Cause.Error() }

func (e *RefusedError) Unwrap() error     { return e.Cause }
func (e *UnreachableError) Unwrap() error { return e.Cause }
func (e *RejectedError) Unwrap() error    { return e.Cause }
func (e *EndedError) Unwrap() error       { return e.Cause }

// Code returns the code of an error of this package, and "" for any other.
func Code(err error) string {
	var found *Error
	if errors.As(err, &found) {
		return found.Code
	}
	return ""
}

func unreachable(code, message, hint string) error {
	return &UnreachableError{&Error{Code: code, Message: message, Hint: hint}}
}

func notUnderstood(what string, err error) error {
	return &Error{Code: CodeNotUnderstood, Message: fmt.Sprintf("this is no %s: %v", what, err), Hint: "do client and server differ in version?"}
}

// refusal turns an error reply into the type that says what it means.
func refusal(reply *ErrorReply) error {
	cause := &Error{Code: reply.Code, Message: reply.Message, Hint: reply.Hint, Details: reply.Details, Diagnostics: reply.Diagnostics}
	if reply.Code == CodeNobodyAnswers || reply.Code == CodeNoAnswer {
		return &UnreachableError{cause}
	}
	return &RefusedError{cause}
}
