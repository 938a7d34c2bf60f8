package mcclient

import (
	"context"
	"crypto/tls"
	"fmt"
	"net/http"
	"net/url"
	"sync"
	"time"

	"github.com/coder/websocket"
	"github.com/vmihailenco/msgpack/v5"
)

const (
	subprotocol  = "mc.v1"
	largestFrame = 16 << 20
	dialTimeout  = 5 * time.Second
	writeTimeout = 5 * time.Second
	pingPeriod   = 2 * time.Second
	pingTimeout  = 5 * time.Second
	firstPause   = 50 * time.Millisecond
	longestPause = time.Second
	// the gateway's answer to too many calls at once, and how long to wait then
	codeTooMuch = "MC071"
	busyPause   = 100 * time.Millisecond

	callTimeout     = 15 * time.Second
	programPatience = 30 * time.Second
)

// Options of a connection; the zero value is for a gateway on this computer.
type Options struct {
	// Token is the secret of the gateway's token file.
	Token string
	// TLS is for wss:// with a certificate authority of one's own.
	TLS *tls.Config
	// CallTimeout is how long a call waits for its reply, lost connections included (15 s); a call for which the server may take longer
	// waits for that time.
	CallTimeout time.Duration
	// Patience is how long a program waits for a motion server that has gone away (30 s).
	Patience time.Duration
}

// Client is one client of a gateway.
//
// A connection that breaks is made anew, for ever: subscriptions are made again, and calls without an answer are sent again with the same
// number, so that none is carried out twice. Where the gateway no longer knows the client (it was restarted, or the connection was away for
// longer than its grace), calls that change something and may have been carried out are not sent again: they fail with MC532.
type Client struct {
	url     string
	options Options
	http    *http.Client

	mu       sync.Mutex
	conn     *websocket.Conn
	session  string
	id       string
	role     string
	number   int64
	pending  map[int64]*call
	topics   map[int64]*topic
	closed   bool
	stop     context.CancelFunc
	finished chan struct{}
}

// call is a frame that waits for its reply.
type call struct {
	frame  map[string]any
	method string
	sent   bool
	reply  chan reply
}

type reply struct {
	value msgpack.RawMessage
	err   error
}

// topic is one subscription. deliver runs in the reading goroutine and must not block; resumed runs after a lost connection.
type topic struct {
	machine, name string
	deliver       func(payload []byte)
	resumed       func()
	ended         func(error)
}

// Dial connects to a gateway, such as ws://127.0.0.1:8787/v1/ws.
//
// It fails with an UnreachableError (MC530) where none answers or the token is wrong.
func Dial(ctx context.Context, gateway string, options *Options) (*Client, error) {
	if options == nil {
		options = &Options{}
	}
	parsed, err := url.Parse(gateway)
	if err != nil || (parsed.Scheme != "ws" && parsed.Scheme != "wss") {
		return nil, &Error{Code: CodeMisconfigured, Message: fmt.Sprintf("%q is no WebSocket address", gateway), Hint: "such as ws://127.0.0.1:8787/v1/ws"}
	}
	client := &Client{
		url: gateway, options: *options, pending: map[int64]*call{}, topics: map[int64]*topic{}, finished: make(chan struct{}),
	}
	transport := http.DefaultTransport.(*http.Transport).Clone()
	transport.TLSClientConfig = options.TLS
	client.http = &http.Client{Transport: transport}
	running, stop := context.WithCancel(context.Background())
	client.stop = stop
	conn, err := client.open(ctx)
	if err != nil {
		stop()
		return nil, err
	}
	go client.run(running, conn)
	return client, nil
}

// ID is this client's id as others see it in events. It changes where the gateway no longer knows the client.
func (c *Client) ID() string {
	c.mu.Lock()
	defer c.mu.Unlock()
	return c.id
}

// Role is what the token may do: observer, operator or engineer.
func (c *Client) Role() string {
	c.mu.Lock()
	defer c.mu.Unlock()
	return c.role
}

// Close ends the connection. Programs that are still open end as their FinishOnDisconnect says, without their grace.
func (c *Client) Close() error {
	c.mu.Lock()
	if c.closed {
		c.mu.Unlock()
		return nil
	}
	c.closed = true
	conn := c.conn
	c.mu.Unlock()
	if conn != nil {
		_ = conn.Close(websocket.StatusNormalClosure, "")
	}
	c.stop()
	<-c.finished
	return nil
}

// Machines lists the machines that are there.
func (c *Client) Machines(ctx context.Context) ([]string, error) {
	value, err := c.request(ctx, map[string]any{"op": "machines"}, "machines")
	if err != nil {
		return nil, err
	}
	var names []string
	if err := msgpack.Unmarshal(value, &names); err != nil {
		return nil, notUnderstood("list of machines", err)
	}
	return names, nil
}

// Machine finds a machine by its name; "" means the only one that is there.
func (c *Client) Machine(ctx context.Context, name string) (*Machine, error) {
	if name == "" {
		names, err := c.Machines(ctx)
		if err != nil {
			return nil, err
		}
		if len(names) != 1 {
			return nil, unreachable(CodeWhichMachine, fmt.Sprintf("%d machines are there: %v", len(names), names), "name one")
		}
		name = names[0]
	}
	machine := &Machine{client: c, name: name}
	info, err := callFor[Info](ctx, machine, "info", nil)
	if err != nil {
		return nil, err
	}
	machine.Info = *info
	return machine, nil
}

// request sends a frame and waits for its reply, over lost connections.
func (c *Client) request(ctx context.Context, frame map[string]any, method string) (msgpack.RawMessage, error) {
	limit := c.options.CallTimeout
	if limit == 0 {
		limit = callTimeout
	}
	limit = max(limit, deadlines[method])
	waiting, cancel := context.WithTimeout(ctx, limit)
	defer cancel()
	c.mu.Lock()
	if c.closed {
		c.mu.Unlock()
		return nil, closedError()
	}
	c.number++
	id := c.number
	frame["id"] = id
	if frame["op"] == "call" {
		frame["request"] = id
	}
	made := &call{frame: frame, method: method, reply: make(chan reply, 1)}
	c.pending[id] = made
	conn := c.conn
	made.sent = conn != nil
	c.mu.Unlock()
	defer c.forget(id)
	if conn != nil {
		c.write(conn, frame)
	}
	for {
		select {
		case answer := <-made.reply:
			if Code(answer.err) != codeTooMuch || sleep(waiting, busyPause) != nil {
				return answer.value, answer.err
			}
			// it was not carried out
			c.repeat(id, made)
		case <-waiting.Done():
			if ctx.Err() != nil {
				return nil, ctx.Err()
			}
			return nil, unreachable(CodeNoAnswer, fmt.Sprintf("no answer to %s within %s", method, limit), "is the gateway running?")
		}
	}
}

// put sends a frame that has no answer, of which the next one is newer; where the connection is away it is lost.
func (c *Client) put(frame map[string]any) error {
	c.mu.Lock()
	conn, closed := c.conn, c.closed
	c.mu.Unlock()
	if closed {
		return closedError()
	}
	if conn != nil {
		c.write(conn, frame)
	}
	return nil
}

// repeat sends a call again.
func (c *Client) repeat(id int64, made *call) {
	c.mu.Lock()
	if c.closed {
		c.mu.Unlock()
		made.reply <- reply{err: closedError()}
		return
	}
	c.pending[id] = made
	conn := c.conn
	c.mu.Unlock()
	if conn != nil {
		c.write(conn, made.frame)
	}
}

func (c *Client) forget(id int64) {
	c.mu.Lock()
	delete(c.pending, id)
	c.mu.Unlock()
}

// listen subscribes to a topic until the function that it returns is called.
func (c *Client) listen(ctx context.Context, made *topic) (func(), error) {
	frame := map[string]any{"op": "subscribe", "machine": made.machine, "topic": made.name}
	c.mu.Lock()
	if c.closed {
		c.mu.Unlock()
		return nil, closedError()
	}
	c.number++
	id := c.number
	c.topics[id] = made
	frame["id"] = id
	waiting := &call{frame: frame, method: "subscribe", reply: make(chan reply, 1)}
	c.pending[id] = waiting
	conn := c.conn
	c.mu.Unlock()
	defer c.forget(id)
	stop := func() {
		c.mu.Lock()
		_, found := c.topics[id]
		delete(c.topics, id)
		conn := c.conn
		c.mu.Unlock()
		if found && conn != nil {
			c.write(conn, map[string]any{"op": "unsubscribe", "id": id})
		}
	}
	if conn != nil {
		c.write(conn, frame)
	}
	limited, cancel := context.WithTimeout(ctx, callTimeout)
	defer cancel()
	select {
	case answer := <-waiting.reply:
		if answer.err != nil {
			stop()
			return nil, answer.err
		}
		return stop, nil
	case <-limited.Done():
		stop()
		if ctx.Err() != nil {
			return nil, ctx.Err()
		}
		return nil, unreachable(CodeNoAnswer, fmt.Sprintf("no answer to subscribe %s", made.name), "is the gateway running?")
	}
}

func closedError() error {
	return &UnreachableError{&Error{Code: CodeClientClosed, Message: "the client has been closed"}}
}
