package mcclient

import (
	"encoding/json"
	"math"
	"path/filepath"
	"reflect"
	"strings"
	"testing"
	"time"
)

// targetPlayer plays a sequence of targets of the contract.
type targetPlayer struct {
	t      *testing.T
	stream *stream
	seq    int64
	put    []any
	status *ProgramStatus
	failed error
}

func TestServoModeGoesAsTheContractSays(t *testing.T) {
	files, err := filepath.Glob(filepath.Join(contract, "targets", "*.json"))
	if err != nil || len(files) == 0 {
		t.Fatal("no sequences", err)
	}
	for _, file := range files {
		var made sequence
		readJSON(t, filepath.Join("targets", filepath.Base(file)), &made)
		t.Run(made.Name, func(t *testing.T) {
			play := &targetPlayer{t: t}
			for number, step := range made.Steps {
				for what, value := range step {
					play.step(number, what, value)
				}
			}
		})
	}
}

func (p *targetPlayer) step(number int, what string, value json.RawMessage) {
	t := p.t
	t.Helper()
	switch what {
	case "servo":
		p.stream = servoStream(of[ServoReply](t, value))
	case "refused":
		p.failed = refusal(of[ErrorReply](t, value))
	case "targets":
		p.targets(value)
	case "puts":
		var wanted []any
		must(t, json.Unmarshal(value, &wanted))
		if found := plain(t, p.put); !reflect.DeepEqual(found, wanted) {
			t.Fatalf("step %d: puts %v, not %v", number, found, wanted)
		}
		p.put = nil
	case "lost":
	case "asked":
		p.status = of[ProgramStatus](t, value)
	case "counts":
		wanted := map[string]float64{}
		must(t, json.Unmarshal(value, &wanted))
		counted := asJSON(reflect.ValueOf(*p.status.Servo)).(map[string]any)
		for name, count := range wanted {
			if counted[name] != count {
				t.Fatalf("step %d: %s is %v, not %v", number, name, counted[name], count)
			}
		}
	case "ack":
		p.stream.acknowledged(of[Ack](t, value))
	case "knows":
		var wanted struct{ State ProgramState }
		must(t, json.Unmarshal(value, &wanted))
		if p.stream.state != wanted.State {
			t.Fatalf("step %d: it is %s, not %s", number, p.stream.state, wanted.State)
		}
	case "fails":
		var wanted struct{ Code, Says string }
		must(t, json.Unmarshal(value, &wanted))
		if Code(p.failed) != wanted.Code || !strings.Contains(p.failed.Error(), wanted.Says) || p.put != nil {
			t.Fatalf("step %d: %v with %v, not %s", number, p.failed, p.put, wanted.Code)
		}
	default:
		t.Fatalf("step %d: there is no %s", number, what)
	}
}

func (p *targetPlayer) targets(value json.RawMessage) {
	var given struct {
		Sent       float64
		Times      []float64
		Counts     float64 `json:"counts_s"`
		Positions  [][]float64
		Velocities [][]float64
		Tool       *int64
		Frame      string
	}
	must(p.t, json.Unmarshal(value, &given))
	if p.failed = p.stream.targets(given.Sent, given.Counts); p.failed != nil {
		return
	}
	targets := Targets{Positions: given.Positions, Velocities: given.Velocities, Counts: seconds(given.Counts), Tool: given.Tool, InToolFrame: given.Frame == "tool"}
	for _, each := range given.Times {
		targets.Times = append(targets.Times, seconds(each))
	}
	p.seq++
	p.put = targets.message(p.seq, given.Sent)
}

func seconds(value float64) time.Duration { return time.Duration(math.Round(value * 1e9)) }

func plain(t *testing.T, value any) any {
	t.Helper()
	text, err := json.Marshal(value)
	must(t, err)
	var found any
	must(t, json.Unmarshal(text, &found))
	return found
}
