// Command conformance does one task against a gateway and says on standard output, as JSON, one object a line, what came of it.
//
//	conformance URL TOKEN stream FILE [PROGRAM] | cancel FILE | watch ROWS | jog AXIS VELOCITY MS | estop | bench FILE
package main

import (
	"bufio"
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"iter"
	"os"
	"slices"
	"strconv"
	"sync/atomic"
	"time"

	"mcserver.example/mcclient"
)

// a server that is killed needs so long at most to be there again
const patience = 2 * time.Minute

type task struct {
	ctx     context.Context
	machine *mcclient.Machine
	args    []string
}

func main() {
	if len(os.Args) < 4 {
		fmt.Fprintln(os.Stderr, "usage: conformance URL TOKEN TASK ...")
		os.Exit(2)
	}
	if err := run(os.Args[1], os.Args[2], os.Args[3], os.Args[4:]); err != nil {
		var known *mcclient.Error
		if !errors.As(err, &known) {
			fmt.Fprintln(os.Stderr, err)
			os.Exit(1)
		}
		said := map[string]any{"code": known.Code, "message": known.Message, "hint": known.Hint, "diagnostics": diagnostics(known.Diagnostics)}
		var ended *mcclient.EndedError
		if errors.As(err, &ended) {
			said["accepted"], said["done"] = ended.Accepted, ended.Done
		}
		say(said)
		os.Exit(1)
	}
}

func run(url, token, name string, args []string) error {
	tasks := map[string]func(task) error{"stream": stream, "cancel": cancel, "watch": watch, "jog": jog, "estop": estop, "bench": bench}
	chosen, found := tasks[name]
	if !found {
		return fmt.Errorf("there is no task %s", name)
	}
	ctx := context.Background()
	client, err := mcclient.Dial(ctx, url, &mcclient.Options{Token: token, Patience: patience})
	if err != nil {
		return err
	}
	defer client.Close()
	machine, err := client.Machine(ctx, "")
	if err != nil {
		return err
	}
	return chosen(task{ctx, machine, args})
}

func stream(t task) error {
	open := func() (*mcclient.Program, error) {
		return t.machine.Program(t.ctx, &mcclient.OpenRequest{Name: t.args[0], OnDisconnect: mcclient.Ptr(mcclient.OnDisconnectFinish)})
	}
	if len(t.args) > 1 {
		request := mcclient.ContinueRequest{Program: t.args[1], Way: true, OnDisconnect: mcclient.Ptr(mcclient.OnDisconnectFinish)}
		open = func() (*mcclient.Program, error) { return t.machine.ContinueProgram(t.ctx, request, show) }
	}
	program, err := open()
	if err != nil {
		return err
	}
	say(map[string]any{"program": program.ID})
	if rest := slices.Collect(linesOf(t.args[0], program.Given()+1)); len(rest) > 0 {
		if err := program.SendLines(t.ctx, slices.Values(rest)); err != nil {
			return err
		}
	}
	if err := program.Finish(t.ctx); err != nil {
		return err
	}
	say(map[string]any{"state": program.State(), "accepted": program.Accepted(), "done": program.Done()})
	return nil
}

func show(shown *mcclient.Continuation) error {
	say(map[string]any{"continuation": map[string]any{"line": shown.Line, "done": shown.Done, "axes": len(shown.Axes)}})
	return nil
}

// linesOf reads a file from a line on.
func linesOf(name string, start int64) iter.Seq[string] {
	return func(yield func(string) bool) {
		file, err := os.Open(name)
		if err != nil {
			fmt.Fprintln(os.Stderr, err)
			os.Exit(2)
		}
		defer file.Close()
		scanner := bufio.NewScanner(file)
		for line := int64(1); scanner.Scan(); line++ {
			if line >= start && !yield(scanner.Text()) {
				return
			}
		}
	}
}

// cancel streams a file over and over, gives that up in the middle, and goes on with one line.
func cancel(t task) error {
	lines := slices.Collect(linesOf(t.args[0], 1))
	program, err := t.machine.Program(t.ctx, nil)
	if err != nil {
		return err
	}
	var fed atomic.Int64
	ctx, stop := context.WithCancel(t.ctx)
	streaming := make(chan error, 1)
	go func() {
		streaming <- program.SendLines(ctx, func(yield func(string) bool) {
			for yield(lines[min(fed.Add(1), int64(len(lines)))-1]) {
			}
		})
	}()
	err = program.WaitDone(t.ctx, int64(len(lines)))
	stop()
	if given := <-streaming; err != nil || !errors.Is(given, context.Canceled) {
		return errors.Join(err, given)
	}
	next, err := program.Send(t.ctx, lines[len(lines)-1])
	if err != nil {
		return err
	}
	before := fed.Load()
	if err := program.Finish(t.ctx); err != nil {
		return err
	}
	say(map[string]any{"next": next, "fed": before, "fed_later": fed.Load() - before, "accepted": program.Accepted(), "done": program.Done()})
	return nil
}

func watch(t task) error {
	feed, err := t.machine.Samples(t.ctx)
	if err != nil {
		return err
	}
	defer feed.Close()
	seen, next, gaps, axes := int64(0), int64(-1), 0, 0
	for samples := range feed.All(t.ctx) {
		if next >= 0 && samples.Seq != next {
			gaps++
		}
		next = samples.Seq + int64(samples.Rows)
		seen += int64(samples.Rows)
		axes = len(samples.Axes)
		if seen >= number(t.args[0]) {
			break
		}
	}
	say(map[string]any{"rows": seen, "gaps": gaps, "axes": axes})
	return nil
}

func jog(t task) error {
	velocity, err := strconv.ParseFloat(t.args[1], 64)
	if err != nil {
		return err
	}
	ctx, cancel := context.WithTimeout(t.ctx, time.Duration(number(t.args[2]))*time.Millisecond)
	defer cancel()
	if err := t.machine.JogWhile(ctx, number(t.args[0]), velocity); err != nil {
		return err
	}
	say(map[string]any{"ok": true})
	return nil
}

func estop(t task) error {
	if err := t.machine.EmergencyStop(t.ctx, "conformance"); err != nil {
		return err
	}
	status, err := t.machine.Status(t.ctx)
	if err != nil {
		return err
	}
	say(map[string]any{"state": status.State})
	return nil
}

func number(text string) int64 {
	value, err := strconv.ParseInt(text, 10, 64)
	if err != nil {
		fmt.Fprintln(os.Stderr, err)
		os.Exit(2)
	}
	return value
}

func diagnostics(found []mcclient.Diagnostic) []map[string]any {
	shown := []map[string]any{}
	for _, each := range found {
		shown = append(shown, map[string]any{"code": each.Code, "line": each.Line, "column": each.Column, "message": each.Message})
	}
	return shown
}

func say(value any) {
	text, err := json.Marshal(value)
	if err != nil {
		panic(err)
	}
	fmt.Println(string(text))
}
