package mcclient

import (
	"encoding/json"
	"errors"
	"os"
	"path/filepath"
	"reflect"
	"strings"
	"testing"
)

type sequence struct {
	Name       string
	ChunkLines int                          `json:"chunk_lines"`
	PutsOnly   bool                         `json:"puts_only"`
	Steps      []map[string]json.RawMessage `json:"steps"`
}

// player plays a sequence of the contract on a stream.
type player struct {
	t       *testing.T
	stream  *stream
	chunk   int
	closing bool
}

func TestEverySequenceGoesAsTheContractSays(t *testing.T) {
	files, err := filepath.Glob(filepath.Join(contract, "sequences", "*.json"))
	if err != nil || len(files) == 0 {
		t.Fatal("no sequences", err)
	}
	for _, file := range files {
		text, err := os.ReadFile(file)
		if err != nil {
			t.Fatal(err)
		}
		var made sequence
		if err := json.Unmarshal(text, &made); err != nil {
			t.Fatal(err)
		}
		if made.PutsOnly {
			continue
		}
		t.Run(made.Name, func(t *testing.T) {
			play := &player{t: t, chunk: made.ChunkLines}
			for number, step := range made.Steps {
				for what, value := range step {
					play.step(number, what, value)
				}
			}
		})
	}
}

func of[T any](t *testing.T, value json.RawMessage) *T {
	t.Helper()
	var found message
	if err := json.Unmarshal(value, &found); err != nil {
		t.Fatal(err)
	}
	made, err := decode[T](unhex(t, found.Bytes))
	if err != nil {
		t.Fatal(err)
	}
	return made
}

func (p *player) step(number int, what string, value json.RawMessage) {
	t := p.t
	t.Helper()
	switch what {
	case "open":
		p.stream = newStream(of[OpenReply](t, value))
		p.stream.chunkLines = p.chunk
	case "continues":
		p.stream = continuedStream(of[ContinueReply](t, value))
		p.stream.chunkLines = p.chunk
	case "give":
		var lines []string
		must(t, json.Unmarshal(value, &lines))
		for _, line := range lines {
			p.stream.give(line)
		}
	case "judge":
		var line string
		must(t, json.Unmarshal(value, &line))
		p.stream.give(line)
	case "sends":
		var wanted struct {
			First, Rejections int64
			Lines             []string
		}
		must(t, json.Unmarshal(value, &wanted))
		first, lines := p.stream.next()
		if p.stream.rejections != wanted.Rejections {
			t.Fatalf("step %d: sends after %d rejections, not %d", number, p.stream.rejections, wanted.Rejections)
		}
		if first != wanted.First || !reflect.DeepEqual(lines, wanted.Lines) {
			t.Fatalf("step %d: sends %d %q, not %d %q", number, first, lines, wanted.First, wanted.Lines)
		}
	case "quiet":
		if first, lines := p.stream.next(); lines != nil {
			t.Fatalf("step %d: sends %d %q", number, first, lines)
		}
	case "lost":
	case "answer":
		var answer map[string]json.RawMessage
		must(t, json.Unmarshal(value, &answer))
		p.answer(answer)
	case "ack":
		p.stream.acknowledged(of[Ack](t, value))
	case "asked":
		if string(value) == "null" {
			p.stream.asked(nil)
		} else {
			p.stream.asked(of[ProgramStatus](t, value))
		}
	case "closes":
		var wanted struct{ Last int64 }
		must(t, json.Unmarshal(value, &wanted))
		if p.stream.accepted != wanted.Last || len(p.stream.waiting) > 0 {
			t.Fatalf("step %d: closes at %d, not at %d", number, p.stream.accepted, wanted.Last)
		}
		p.closing = true
	case "knows":
		var wanted struct {
			Accepted, Done int64
			State          ProgramState
		}
		must(t, json.Unmarshal(value, &wanted))
		if p.stream.accepted != wanted.Accepted || p.stream.done != wanted.Done || p.stream.state != wanted.State {
			t.Fatalf("step %d: knows %d %d %s, not %+v", number, p.stream.accepted, p.stream.done, p.stream.state, wanted)
		}
	case "fails":
		var wanted struct {
			Code, Says   string
			Line, Column int64
		}
		must(t, json.Unmarshal(value, &wanted))
		if Code(p.stream.failure) != wanted.Code || !strings.Contains(p.stream.failure.Error(), wanted.Says) {
			t.Fatalf("step %d: fails with %v, not %s %s", number, p.stream.failure, wanted.Code, wanted.Says)
		}
		var rejected *RejectedError
		if wanted.Line > 0 && (!errors.As(p.stream.failure, &rejected) || rejected.Line != wanted.Line || rejected.Column != wanted.Column) {
			t.Fatalf("step %d: fails with %v, not at %d:%d", number, p.stream.failure, wanted.Line, wanted.Column)
		}
		// from here on the application knows
		p.stream.forgive()
	default:
		t.Fatalf("step %d: %s is not known", number, what)
	}
}

func (p *player) answer(answer map[string]json.RawMessage) {
	if p.closing {
		reply := of[CloseReply](p.t, answer["reply"])
		p.stream.numbers(p.stream.rejections, reply.Accepted, reply.Done, p.stream.credit)
		p.closing = false
	} else if refused, found := answer["refused"]; found {
		must(p.t, p.stream.refused(refusal(of[ErrorReply](p.t, refused)).(*RefusedError)))
	} else {
		p.stream.answered(of[SubmitReply](p.t, answer["reply"]))
	}
}

func must(t *testing.T, err error) {
	t.Helper()
	if err != nil {
		t.Fatal(err)
	}
}

func opened(credit int64) *stream {
	return newStream(&OpenReply{Program: "p-1", State: ProgramStateRunning, Expected: 1, Credit: credit})
}

func TestARejectionThatNobodyHasHeardOfKeepsLaterLinesBack(t *testing.T) {
	s := opened(10)
	s.give("G1010")
	s.give("GO1")
	s.next()
	s.answered(&SubmitReply{Program: "p-1", Accepted: 2, Credit: 8})
	s.acknowledged(&Ack{Program: "p-1", Accepted: 1, Credit: 9, State: ProgramStateRunning, Rejected: 2, Rejections: 1, Diagnostics: []Diagnostic{{Code: "MC101", Line: 2}}})
	s.give("G01 X3")
	if _, lines := s.next(); lines != nil || Code(s.failure) != "MC101" {
		t.Fatalf("%q is sent, failure %v", lines, s.failure)
	}
}

func TestAMessageKeepsItsLinesWhenTheyAreGivenUpAndOthersTakeTheirPlace(t *testing.T) {
	s := opened(10)
	s.give("first")
	s.give("second")
	_, sent := s.next()
	s.cut(1)
	s.give("another")
	if sent[0] != "first" || sent[1] != "second" {
		t.Fatalf("the message has become %q", sent)
	}
}

func TestAfterLinesWereGivenUpOnTheirWayTheServersNumberHolds(t *testing.T) {
	s := opened(10)
	s.give("first")
	s.give("second")
	s.next()
	s.abandon()
	if !s.stale {
		t.Fatal("the server is not asked")
	}
	s.asked(&ProgramStatus{Program: "p-1", State: ProgramStateRunning, Accepted: 2, Credit: 8})
	s.give("third")
	if first, lines := s.next(); first != 3 || lines[0] != "third" {
		t.Fatalf("%d %q is sent", first, lines)
	}
}

func TestAcknowledgementsOfAnotherProgramChangeNothing(t *testing.T) {
	s := opened(10)
	s.give("first")
	s.acknowledged(&Ack{Program: "p-2", Accepted: 1, Done: 1, State: ProgramStateAborted})
	if s.accepted != 0 || s.state != ProgramStateRunning {
		t.Fatalf("accepted %d, %s", s.accepted, s.state)
	}
}

func TestALateAcknowledgementOfARejectionDoesNotRejectTheCorrectedLine(t *testing.T) {
	s := opened(10)
	old := &Ack{Program: "p-1", Credit: 9, State: ProgramStateRunning, Rejected: 1, Rejections: 1, Diagnostics: []Diagnostic{{Code: "MC101", Line: 1}}}
	s.give("GO1")
	s.next()
	s.answered(&SubmitReply{Program: "p-1", Accepted: 1, Credit: 9})
	s.acknowledged(old)
	s.forgive()
	s.give("G01")
	s.next()
	s.acknowledged(old)
	if s.failure != nil || s.stale {
		t.Fatalf("failure %v, stale %v", s.failure, s.stale)
	}
	s.acknowledged(&Ack{Program: "p-1", Credit: 9, State: ProgramStateRunning, Rejected: 1, Rejections: 2})
	if Code(s.failure) != "MC100" {
		t.Fatalf("the corrected line is faulty too: %v", s.failure)
	}
}

func TestARejectionAmongLinesThatWereGivenUpOnTheirWayLeavesTheServersNumber(t *testing.T) {
	s := opened(10)
	s.give("first")
	s.give("GO1")
	s.next()
	s.abandon()
	s.acknowledged(&Ack{Program: "p-1", Accepted: 1, Credit: 9, State: ProgramStateRunning, Rejected: 2, Rejections: 1})
	s.give("third")
	if first, lines := s.next(); first != 2 || lines[0] != "third" || s.failure != nil {
		t.Fatalf("%d %q is sent, failure %v", first, lines, s.failure)
	}
}
