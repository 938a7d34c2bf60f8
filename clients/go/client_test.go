package mcclient

import (
	"context"
	"errors"
	"net/http"
	"net/http/httptest"
	"slices"
	"strings"
	"sync"
	"sync/atomic"
	"testing"
	"time"

	"github.com/coder/websocket"
	"github.com/vmihailenco/msgpack/v5"
)

// fakeGateway speaks frames and nothing else: each call is answered by the test's function.
type fakeGateway struct {
	t      *testing.T
	server *httptest.Server
	answer func(method string, params map[string]any) (any, *ErrorReply, bool)

	mu      sync.Mutex
	asked   []string
	numbers []int64
	conn    *websocket.Conn
	resumed bool
}

var fakeInfo = map[string]any{
	"machine": "cell", "server": "0", "protocol": []int{1}, "instance": "i", "epoch": 0.0, "cycle_s": 0.001,
	"axes": []any{}, "tools": []any{}, "methods": []string{},
	"telemetry": map[string]any{"axes": []int{0}, "fields": []string{"setpoint"}, "cycles_a_message": 10, "state_hz": 20.0},
	"limits": map[string]any{
		"max_line_length": 100, "max_lines_a_message": 20000, "queue_lines": 100, "programs_at_once": 8, "open_programs": 64,
		"remembered_answers": 64, "remembered_answer_s": 60.0,
	},
}

var continuation = map[string]any{
	"program": "p-0", "name": "", "state": "aborted", "done": 6, "accepted": 6, "whole": false, "sha256": nil, "line": 7, "first": 7,
	"lines": []string{}, "modal": []string{}, "energize": []int{}, "axes": []any{}, "way": []any{}, "switched": []any{}, "needs": []any{},
	"block_delete": false, "optional_stop": true,
}

func newFakeGateway(t *testing.T, answer func(string, map[string]any) (any, *ErrorReply, bool)) *fakeGateway {
	gateway := &fakeGateway{t: t, answer: answer, resumed: true}
	gateway.server = httptest.NewServer(http.HandlerFunc(gateway.serve))
	t.Cleanup(gateway.server.Close)
	return gateway
}

func (g *fakeGateway) machine() *Machine {
	g.t.Helper()
	client, err := Dial(context.Background(), strings.Replace(g.server.URL, "http", "ws", 1), &Options{Patience: 5 * time.Second})
	if err != nil {
		g.t.Fatal(err)
	}
	g.t.Cleanup(func() { _ = client.Close() })
	machine, err := client.Machine(context.Background(), "cell")
	if err != nil {
		g.t.Fatal(err)
	}
	return machine
}

func (g *fakeGateway) serve(writer http.ResponseWriter, request *http.Request) {
	conn, err := websocket.Accept(writer, request, &websocket.AcceptOptions{Subprotocols: []string{subprotocol}})
	if err != nil {
		return
	}
	defer conn.CloseNow()
	g.mu.Lock()
	g.conn = conn
	resumed := g.resumed && request.URL.Query().Has("session")
	g.mu.Unlock()
	g.write(conn, map[string]any{"op": "hello", "client": "c", "session": "s", "role": "operator", "resumed": resumed, "grace_s": 10.0, "protocol": 1})
	for {
		_, payload, err := conn.Read(request.Context())
		if err != nil {
			return
		}
		var frame struct {
			Op      string         `msgpack:"op"`
			ID      int64          `msgpack:"id"`
			Method  string         `msgpack:"method"`
			Params  map[string]any `msgpack:"params"`
			Request int64          `msgpack:"request"`
		}
		if err := msgpack.Unmarshal(payload, &frame); err != nil {
			g.t.Error(err)
			return
		}
		reply := map[string]any{"op": "reply", "id": frame.ID, "ok": true, "value": nil, "error": nil}
		if frame.Op == "call" {
			g.mu.Lock()
			g.asked, g.numbers = append(g.asked, frame.Method), append(g.numbers, frame.Request)
			g.mu.Unlock()
			value, refused, answers := any(fakeInfo), (*ErrorReply)(nil), true
			if frame.Method != "info" {
				value, refused, answers = g.answer(frame.Method, frame.Params)
			}
			if !answers {
				continue
			}
			reply["value"] = value
			if refused != nil {
				reply["ok"], reply["error"] = false, map[string]any{"code": refused.Code, "message": refused.Message}
			}
		}
		g.write(conn, reply)
	}
}

func (g *fakeGateway) write(conn *websocket.Conn, frame map[string]any) {
	payload, err := msgpack.Marshal(frame)
	if err != nil {
		g.t.Error(err)
		return
	}
	_ = conn.Write(context.Background(), websocket.MessageBinary, payload)
}

// breakLink ends the connection; the next one is resumed or not.
func (g *fakeGateway) breakLink(resumed bool) {
	g.mu.Lock()
	conn := g.conn
	g.resumed = resumed
	g.mu.Unlock()
	_ = conn.CloseNow()
}

func (g *fakeGateway) count(method string) int {
	g.mu.Lock()
	defer g.mu.Unlock()
	count := 0
	for _, each := range g.asked {
		if each == method {
			count++
		}
	}
	return count
}

var openReply = map[string]any{"program": "p-1", "state": "running", "axes": []int{0}, "expected": 1, "credit": 10, "instance": "i"}

func status(state string, accepted int) map[string]any {
	return map[string]any{"programs": []any{map[string]any{
		"program": "p-1", "state": state, "client": "c", "name": "", "axes": []int{0}, "start_line": 1, "line": 0, "accepted": accepted, "done": 0,
		"credit": 10, "closed": false, "override": 100.0, "progress": 0.0, "opened_at": 0.0,
	}}}
}

func away() (any, *ErrorReply, bool) { return nil, &ErrorReply{Code: "MC530", Message: "nobody"}, true }

func TestAServerThatIsAwayIsAskedNowAndThenUntilItIsBack(t *testing.T) {
	asked := 0
	gateway := newFakeGateway(t, func(method string, _ map[string]any) (any, *ErrorReply, bool) {
		switch method {
		case "open":
			return openReply, nil, true
		case "programs":
			if asked++; asked > 3 {
				return status("interrupted", 0), nil, true
			}
		}
		return away()
	})
	program, err := gateway.machine().Program(context.Background(), nil)
	if err != nil {
		t.Fatal(err)
	}
	err = program.SendLines(context.Background(), slices.Values([]string{"G1010", "G01 X1"}))
	var ended *EndedError
	if !errors.As(err, &ended) || Code(err) != CodeInterrupted {
		t.Fatal(err)
	}
	if sent := gateway.count("submit"); sent != 1 {
		t.Errorf("lines were sent %d times", sent)
	}
	if asked != 4 {
		t.Errorf("it was asked %d times", asked)
	}
}

func TestAServerThatStaysAwayEndsThePatience(t *testing.T) {
	gateway := newFakeGateway(t, func(method string, _ map[string]any) (any, *ErrorReply, bool) {
		if method == "open" {
			return openReply, nil, true
		}
		return away()
	})
	machine := gateway.machine()
	machine.client.options.Patience = time.Nanosecond
	program, err := machine.Program(context.Background(), nil)
	if err != nil {
		t.Fatal(err)
	}
	err = program.SendLines(context.Background(), slices.Values([]string{"G1010"}))
	if !errors.As(err, new(*UnreachableError)) {
		t.Fatal(err)
	}
}

func TestACallWithoutAnAnswerIsSentAgainUnderItsNumber(t *testing.T) {
	calls := make(chan struct{}, 8)
	var lost atomic.Bool
	gateway := newFakeGateway(t, nil)
	gateway.answer = func(method string, _ map[string]any) (any, *ErrorReply, bool) {
		// set before the call is known of: the link is broken right behind it
		first := !lost.Swap(true)
		calls <- struct{}{}
		return map[string]any{"program": "j-1"}, nil, !first
	}
	machine := gateway.machine()
	done := make(chan error, 1)
	go func() {
		_, err := machine.Jog(context.Background(), JogRequest{Axis: 0, Distance: Ptr(5.0)})
		done <- err
	}()
	<-calls
	gateway.breakLink(true)
	if err := <-done; err != nil {
		t.Fatal(err)
	}
	numbers := gateway.numbers[len(gateway.numbers)-2:]
	if numbers[0] != numbers[1] {
		t.Errorf("the numbers are %v", numbers)
	}
}

func TestAMotionIsNotAskedForTwiceOfAGatewayThatHasForgottenTheClient(t *testing.T) {
	calls := make(chan struct{}, 8)
	gateway := newFakeGateway(t, func(string, map[string]any) (any, *ErrorReply, bool) {
		calls <- struct{}{}
		return nil, nil, false
	})
	machine := gateway.machine()
	done := make(chan error, 1)
	go func() {
		_, err := machine.Jog(context.Background(), JogRequest{Axis: 0, Distance: Ptr(5.0)})
		done <- err
	}()
	<-calls
	gateway.breakLink(false)
	if err := <-done; Code(err) != CodeNoAnswer {
		t.Fatal(err)
	}
	if count := gateway.count("jog"); count != 1 {
		t.Errorf("the jog was sent %d times", count)
	}
}

func TestTooManyCallsAtOnceWait(t *testing.T) {
	busy := 2
	gateway := newFakeGateway(t, func(string, map[string]any) (any, *ErrorReply, bool) {
		if busy--; busy >= 0 {
			return nil, &ErrorReply{Code: codeTooMuch, Message: "too many calls at once"}, true
		}
		return map[string]any{"program": "j-1"}, nil, true
	})
	if program, err := gateway.machine().Jog(context.Background(), JogRequest{Axis: 0, Distance: Ptr(5.0)}); err != nil || program != "j-1" {
		t.Fatal(program, err)
	}
}

func TestAfterAClientIsClosedNothingWaits(t *testing.T) {
	gateway := newFakeGateway(t, func(string, map[string]any) (any, *ErrorReply, bool) { return nil, nil, false })
	machine := gateway.machine()
	feed, err := machine.States(context.Background())
	if err != nil {
		t.Fatal(err)
	}
	_ = machine.client.Close()
	if _, err := feed.Next(context.Background()); Code(err) != CodeClientClosed {
		t.Error(err)
	}
	if _, err := machine.Status(context.Background()); Code(err) != CodeClientClosed {
		t.Error(err)
	}
}

func TestAFeedDropsTheOldestAndCountsThem(t *testing.T) {
	feed := newFeed[int](2)
	for i := range 5 {
		feed.push(i)
	}
	first, _ := feed.Next(context.Background())
	if first != 3 || feed.Missed() != 3 {
		t.Errorf("%d, missed %d", first, feed.Missed())
	}
	feed.Close()
	second, _ := feed.Next(context.Background())
	if _, err := feed.Next(context.Background()); second != 4 || err == nil {
		t.Errorf("%d, %v", second, err)
	}
}

func TestAProgramThatIsOpenedForACallerWhoHasGoneIsAborted(t *testing.T) {
	asked, release, aborted := make(chan struct{}), make(chan struct{}), make(chan any, 1)
	gateway := newFakeGateway(t, func(method string, params map[string]any) (any, *ErrorReply, bool) {
		if method == "open" {
			close(asked)
			<-release
			return openReply, nil, true
		}
		aborted <- params["program"]
		return map[string]any{"ok": true}, nil, true
	})
	machine := gateway.machine()
	ctx, cancel := context.WithCancel(context.Background())
	done := make(chan error, 1)
	go func() {
		_, err := machine.Program(ctx, nil)
		done <- err
	}()
	<-asked
	cancel()
	if err := <-done; !errors.Is(err, context.Canceled) {
		t.Fatal(err)
	}
	close(release)
	if program := <-aborted; program != "p-1" {
		t.Errorf("%v is aborted", program)
	}
}

func TestACallThatIsCancelledWhileLinesAreUnderWayLeavesTheNumbersRight(t *testing.T) {
	var mu sync.Mutex
	asked, release := make(chan struct{}), make(chan struct{})
	var firsts []any
	gateway := newFakeGateway(t, func(method string, params map[string]any) (any, *ErrorReply, bool) {
		if method == "open" {
			return openReply, nil, true
		}
		mu.Lock()
		firsts = append(firsts, params["first"])
		count := len(firsts)
		mu.Unlock()
		if count == 1 {
			close(asked)
			<-release
			return map[string]any{"program": "p-1", "accepted": 2, "done": 0, "credit": 8}, nil, true
		}
		return map[string]any{"program": "p-1", "accepted": 3, "done": 0, "credit": 7}, nil, true
	})
	program, err := gateway.machine().Program(context.Background(), nil)
	if err != nil {
		t.Fatal(err)
	}
	ctx, cancel := context.WithCancel(context.Background())
	done := make(chan error, 1)
	go func() { done <- program.SendLines(ctx, slices.Values([]string{"first", "second"})) }()
	<-asked
	cancel()
	if err := <-done; !errors.Is(err, context.Canceled) {
		t.Fatal(err)
	}
	close(release)
	if err := program.SendLines(context.Background(), slices.Values([]string{"third"})); err != nil {
		t.Fatal(err)
	}
	mu.Lock()
	defer mu.Unlock()
	if len(firsts) != 2 || whole(firsts[1], 0) != 3 || program.Accepted() != 3 {
		t.Errorf("the messages begin with %v, accepted %d", firsts, program.Accepted())
	}
}

func TestALineThatWasFoundFaultyLateIsGivenAgainOnceWaitDoneHasReturnedThat(t *testing.T) {
	var mu sync.Mutex
	var rejections []any
	gateway := newFakeGateway(t, func(method string, params map[string]any) (any, *ErrorReply, bool) {
		switch method {
		case "open":
			return openReply, nil, true
		case "programs":
			found := status("running", 0)
			mine := found["programs"].([]any)[0].(map[string]any)
			mine["rejected"], mine["rejections"] = 1, 1
			mine["diagnostics"] = []any{map[string]any{"code": "MC101", "message": "faulty", "line": 1, "column": 1}}
			return found, nil, true
		}
		mu.Lock()
		defer mu.Unlock()
		rejections = append(rejections, params["rejections"])
		return map[string]any{"program": "p-1", "accepted": 1, "done": 0, "credit": 9, "rejections": params["rejections"]}, nil, true
	})
	program, err := gateway.machine().Program(context.Background(), nil)
	if err != nil {
		t.Fatal(err)
	}
	if _, err := program.Send(context.Background(), "GO1 X1"); err != nil {
		t.Fatal(err)
	}
	var rejected *RejectedError
	if err := program.WaitDone(context.Background(), 2); !errors.As(err, &rejected) || rejected.Line != 1 {
		t.Fatal(err)
	}
	if number, err := program.Send(context.Background(), "G01 X1"); err != nil || number != 1 {
		t.Fatal(number, err)
	}
	mu.Lock()
	defer mu.Unlock()
	if len(rejections) != 2 || whole(rejections[1], 0) != 1 || program.Failure() != nil {
		t.Errorf("sent after %v rejections, failure %v", rejections, program.Failure())
	}
}

func TestNothingGoesOnWhereWhatIsShownIsNotWanted(t *testing.T) {
	gateway := newFakeGateway(t, func(method string, params map[string]any) (any, *ErrorReply, bool) {
		if method != "continuation" {
			t.Errorf("%s is asked for", method)
		}
		return continuation, nil, true
	})
	unwanted := errors.New("not so")
	_, err := gateway.machine().ContinueProgram(context.Background(), ContinueRequest{Program: "p-0"}, func(shown *Continuation) error {
		if shown.Line != 7 {
			t.Errorf("line %d is shown", shown.Line)
		}
		return unwanted
	})
	if !errors.Is(err, unwanted) {
		t.Fatal(err)
	}
}

func TestAJogWhoseContextIsDoneBeforeItHasBegunIsStoppedAndIsNoError(t *testing.T) {
	ctx, cancel := context.WithCancel(context.Background())
	gateway := newFakeGateway(t, func(method string, _ map[string]any) (any, *ErrorReply, bool) {
		switch method {
		case "info":
			return fakeInfo, nil, true
		case "jog":
			cancel()
			return map[string]any{"program": "j-1"}, nil, true
		}
		return map[string]any{}, nil, true
	})
	if err := gateway.machine().JogWhile(ctx, 0, 5); err != nil {
		t.Error(err)
	}
	if count := gateway.count("abort"); count != 1 {
		t.Errorf("it was stopped %d times", count)
	}
}

func taking() (func(string, map[string]any) (any, *ErrorReply, bool), *atomic.Int64) {
	var taken atomic.Int64
	return func(method string, params map[string]any) (any, *ErrorReply, bool) {
		switch method {
		case "open":
			return map[string]any{"program": "p", "state": "running", "axes": []int{0}, "expected": 1, "credit": 100, "instance": "i"}, nil, true
		case "submit":
			count := taken.Add(int64(len(params["lines"].([]any))))
			return map[string]any{"program": "p", "accepted": count, "done": count, "credit": 100, "rejections": 0}, nil, true
		}
		return map[string]any{"programs": []any{}}, nil, true
	}, &taken
}

func TestLinesGoOutWhileTheirSourceWaitsForThemToBeAccepted(t *testing.T) {
	answer, taken := taking()
	program, err := newFakeGateway(t, answer).machine().Program(context.Background(), nil)
	if err != nil {
		t.Fatal(err)
	}
	slow := func(yield func(string) bool) {
		for number := int64(1); number <= 3; number++ {
			if !yield("G01 X1") {
				return
			}
			for taken.Load() < number {
				time.Sleep(time.Millisecond)
			}
		}
	}
	if err := program.SendLines(context.Background(), slow); err != nil || program.Accepted() != 3 {
		t.Fatalf("accepted %d: %v", program.Accepted(), err)
	}
}

func TestAStreamWhoseContextIsDoneFeedsNothingMore(t *testing.T) {
	answer, taken := taking()
	program, err := newFakeGateway(t, answer).machine().Program(context.Background(), nil)
	if err != nil {
		t.Fatal(err)
	}
	ctx, cancel := context.WithCancel(context.Background())
	given := 0
	endless := func(yield func(string) bool) {
		for yield("G01 X1") {
			if given++; given == 50 {
				cancel()
			}
		}
	}
	if err := program.SendLines(ctx, endless); !errors.Is(err, context.Canceled) {
		t.Fatalf("it ended with %v", err)
	}
	sent := taken.Load()
	if number, err := program.Send(context.Background(), "G01 X2"); err != nil || number != taken.Load() || number > sent+101 {
		t.Fatalf("line %d of %d: %v", number, taken.Load(), err)
	}
}
