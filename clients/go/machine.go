package mcclient

import (
	"context"
	"errors"
	"math/rand"
	"reflect"
	"time"

	"github.com/vmihailenco/msgpack/v5"
)

const (
	stateLimit  = 32
	sampleLimit = 4096
	eventLimit  = 4096
	eventPage   = 1000

	holdS      = 0.35
	keepPeriod = 100 * time.Millisecond
	stopLimit  = 2 * time.Second
)

// Machine is a motion server behind a gateway.
type Machine struct {
	// Info describes the machine as it was when it was found.
	Info   Info
	client *Client
	name   string
}

// Name is the machine's name.
func (m *Machine) Name() string { return m.name }

// Call calls any remote method by its name (docs/wire/calls.md) and reads the value of its reply into one of the message types or anything that
// the MessagePack library takes; nil: the value is not wanted.
func (m *Machine) Call(ctx context.Context, method string, params map[string]any, into any) error {
	if params == nil {
		params = map[string]any{}
	}
	frame := map[string]any{"op": "call", "machine": m.name, "method": method, "params": params}
	value, err := m.client.request(ctx, frame, method)
	if err != nil || into == nil {
		return err
	}
	if err := readReply(value, into); err != nil {
		return notUnderstood("reply to "+method, err)
	}
	return nil
}

func readReply(value msgpack.RawMessage, into any) error {
	target := reflect.ValueOf(into)
	if target.Kind() == reflect.Pointer && target.Elem().Kind() == reflect.Struct {
		return decodeInto(value, target.Elem())
	}
	return msgpack.Unmarshal(value, into)
}

func callFor[T any](ctx context.Context, m *Machine, method string, params map[string]any) (*T, error) {
	into := new(T)
	if err := m.Call(ctx, method, params, into); err != nil {
		return nil, err
	}
	return into, nil
}

// EmergencyStop stops everything, on a connection of its own beside the one that is there; it returns once the server has confirmed.
//
// It is no safety function: machines need a circuit of their own.
func (m *Machine) EmergencyStop(ctx context.Context, reason string) error {
	ctx, cancel := context.WithCancel(ctx)
	defer cancel()
	outcomes := make(chan error, 2)
	go func() { outcomes <- m.client.stopMachine(ctx, m.name, reason) }()
	go func() { outcomes <- EmergencyStop(ctx, m.client.url, m.name, reason, &m.client.options) }()
	first := <-outcomes
	if first == nil {
		return nil
	}
	if second := <-outcomes; second != nil {
		return errors.Join(first, second)
	}
	return nil
}

// EmergencyStop stops a machine over a connection of its own, for those who have none yet.
func EmergencyStop(ctx context.Context, gateway, machine, reason string, options *Options) error {
	client, err := Dial(ctx, gateway, options)
	if err != nil {
		return err
	}
	defer client.Close()
	return client.stopMachine(ctx, machine, reason)
}

func (c *Client) stopMachine(ctx context.Context, machine, reason string) error {
	// all copies of one stop have its number: a late one does not stop again what has been reset meanwhile
	number := int64(1)<<32 + rand.Int63n(1<<52)
	_, err := c.request(ctx, map[string]any{"op": "estop", "machine": machine, "reason": reason, "request": number}, "estop")
	return err
}

// JogWhile moves an axis until the context is done; the velocity is signed [mm/s, deg/s]. The server's dead man's time stops the axis when
// this process, its link or the gateway dies. A context that is done is no error.
func (m *Machine) JogWhile(ctx context.Context, axis int64, velocity float64) error {
	if ctx.Err() != nil {
		return nil
	}
	request := JogRequest{Axis: axis, Velocity: Ptr(velocity), HoldS: Ptr(holdS)}
	// also when the context is done before the reply has come: only who knows the jog can stop it
	program, err := m.Jog(context.WithoutCancel(ctx), request)
	if err != nil {
		return err
	}
	defer func() {
		// it may have ended by itself: at a limit, by a fault, or for want of keeps
		stopping, cancel := context.WithTimeout(context.WithoutCancel(ctx), stopLimit)
		defer cancel()
		_, _ = m.Abort(stopping, program)
	}()
	ticks := time.NewTicker(keepPeriod)
	defer ticks.Stop()
	for {
		select {
		case <-ctx.Done():
			return nil
		case <-ticks.C:
		}
		request.Program = program
		if _, err := m.Jog(ctx, request); err != nil {
			if ctx.Err() != nil {
				return nil
			}
			return err
		}
	}
}

// States is the whole machine some 20 times a second; a slow reader gets the newest.
func (m *Machine) States(ctx context.Context) (*Feed[*MachineStatus], error) {
	return listenTo(ctx, m, "state", stateLimit, decode[MachineStatus])
}

// Samples is every cycle of every axis, some cycles at a time.
func (m *Machine) Samples(ctx context.Context) (*Feed[*Samples], error) {
	return listenTo(ctx, m, "samples", sampleLimit, func(payload []byte) (*Samples, error) {
		return decodeSamples(payload, &m.Info.Telemetry, m.Info.CycleS)
	})
}

func listenTo[T any](ctx context.Context, m *Machine, name string, limit int, read func([]byte) (*T, error)) (*Feed[*T], error) {
	feed := newFeed[*T](limit)
	stop, err := m.client.listen(ctx, &topic{
		machine: m.name,
		name:    name,
		deliver: func(payload []byte) {
			// what is not understood costs itself only
			if value, err := read(payload); err == nil {
				feed.push(value)
			}
		},
		resumed: func() {},
		ended:   feed.end,
	})
	if err != nil {
		return nil, err
	}
	feed.release = stop
	return feed, nil
}
