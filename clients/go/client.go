package mcclient

import (
	"bytes"
	"context"
	"crypto/tls"
	"errors"
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
	longTimeout     = 2 * time.Minute
	programPatience = 30 * time.Second
)

// Options of a connection; the zero value is for a gateway on this computer.
type Options struct {
	// Token is the secret of the gateway's token file.
	Token string
	// TLS is for wss:// with a certificate authority of one's own.
	TLS *tls.Config
	// CallTimeout is how long a call waits for its reply, lost connections included (15 s); check and simulate have 2 min.
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

// what may be asked again under any circumstances, as it changes nothing
var reading = map[string]bool{
	"info": true, "status": true, "programs": true, "events": true, "check": true, "simulate": true, "drives": true,
	"sdo_read": true, "run_requests": true, "run_preview": true, "machines": true, "subscribe": true,
	// stopping twice stops
	"estop": true, "abort": true, "hold": true,
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

// Close ends the connection. Programs that are still open end as their OnDisconnect says, after the gateway's grace.
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
	if method == "check" || method == "simulate" {
		limit = longTimeout
	}
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

// run reads one connection after another until the client is closed.
func (c *Client) run(ctx context.Context, conn *websocket.Conn) {
	defer close(c.finished)
	defer c.end()
	pause := firstPause
	for {
		if conn != nil {
			begun := time.Now()
			c.read(ctx, conn)
			// one that breaks at once is no reason to hurry
			if time.Since(begun) > longestPause {
				pause = firstPause
			}
		}
		if ctx.Err() != nil || c.isClosed() {
			return
		}
		select {
		case <-ctx.Done():
			return
		case <-time.After(pause):
		}
		pause = min(2*pause, longestPause)
		conn, _ = c.open(ctx)
	}
}

func (c *Client) isClosed() bool {
	c.mu.Lock()
	defer c.mu.Unlock()
	return c.closed
}

// end fails what still waits.
func (c *Client) end() {
	c.mu.Lock()
	c.closed, c.conn = true, nil
	pending, topics := c.pending, c.topics
	c.pending, c.topics = map[int64]*call{}, map[int64]*topic{}
	c.mu.Unlock()
	for _, each := range pending {
		each.reply <- reply{err: closedError()}
	}
	for _, each := range topics {
		each.ended(closedError())
	}
	c.http.CloseIdleConnections()
}

// open makes a connection, takes the session up again where there is one, and sends what waits.
func (c *Client) open(ctx context.Context) (*websocket.Conn, error) {
	ctx, cancel := context.WithTimeout(ctx, dialTimeout)
	defer cancel()
	c.mu.Lock()
	session := c.session
	c.mu.Unlock()
	address := c.url
	if session != "" {
		address += "?session=" + url.QueryEscape(session)
	}
	header := http.Header{}
	if c.options.Token != "" {
		header.Set("Authorization", "Bearer "+c.options.Token)
	}
	conn, _, err := websocket.Dial(ctx, address, &websocket.DialOptions{
		HTTPClient: c.http, HTTPHeader: header, Subprotocols: []string{subprotocol},
	})
	if err != nil {
		return nil, c.unreachable(err)
	}
	conn.SetReadLimit(largestFrame)
	_, payload, err := conn.Read(ctx)
	if err != nil {
		_ = conn.CloseNow()
		return nil, c.unreachable(err)
	}
	hello, err := readFrame(payload)
	if err != nil || hello.op != "hello" {
		_ = conn.CloseNow()
		return nil, notUnderstood("gateway's hello", err)
	}
	c.mu.Lock()
	if c.closed {
		c.mu.Unlock()
		_ = conn.CloseNow()
		return nil, closedError()
	}
	lost := session != "" && !hello.resumed
	c.conn, c.session, c.id, c.role = conn, hello.session, hello.client, hello.role
	send, resumed := c.again(lost)
	c.mu.Unlock()
	for _, frame := range send {
		c.write(conn, frame)
	}
	for _, each := range resumed {
		go each()
	}
	return conn, nil
}

// again lists what a new connection has to send, and whom to say that it is there. Where the gateway has forgotten the client, what may have
// been carried out for the old one fails instead.
func (c *Client) again(lost bool) (send []map[string]any, resumed []func()) {
	for id, each := range c.topics {
		if _, asking := c.pending[id]; !asking {
			send = append(send, map[string]any{"op": "subscribe", "id": id, "machine": each.machine, "topic": each.name})
			resumed = append(resumed, each.resumed)
		}
	}
	for id, each := range c.pending {
		if lost && each.sent && !reading[each.method] {
			delete(c.pending, id)
			each.reply <- reply{err: unreachable(CodeNoAnswer, fmt.Sprintf("the gateway no longer knows this client: whether %s was carried out is not known", each.method), "look at the machine's status before doing it again")}
			continue
		}
		each.sent = true
		send = append(send, each.frame)
	}
	return send, resumed
}

// read takes frames until the connection breaks.
func (c *Client) read(ctx context.Context, conn *websocket.Conn) {
	alive, cancel := context.WithCancel(ctx)
	defer cancel()
	go c.watch(alive, conn)
	for {
		kind, payload, err := conn.Read(ctx)
		if err != nil || kind != websocket.MessageBinary {
			break
		}
		frame, err := readFrame(payload)
		if err != nil {
			// a gateway that writes what is no frame is none
			break
		}
		c.take(frame)
	}
	_ = conn.CloseNow()
	c.mu.Lock()
	if c.conn == conn {
		c.conn = nil
	}
	c.mu.Unlock()
}

// watch breaks a connection on which nothing comes back: a cable that was pulled says nothing by itself.
func (c *Client) watch(ctx context.Context, conn *websocket.Conn) {
	ticks := time.NewTicker(pingPeriod)
	defer ticks.Stop()
	for {
		select {
		case <-ctx.Done():
			return
		case <-ticks.C:
		}
		limited, cancel := context.WithTimeout(ctx, pingTimeout)
		err := conn.Ping(limited)
		cancel()
		if err != nil {
			_ = conn.CloseNow()
			return
		}
	}
}

func (c *Client) take(frame *frame) {
	c.mu.Lock()
	switch frame.op {
	case "message":
		found := c.topics[frame.id]
		c.mu.Unlock()
		if found != nil {
			found.deliver(frame.message)
		}
		return
	case "reply":
		waiting := c.pending[frame.id]
		delete(c.pending, frame.id)
		c.mu.Unlock()
		if waiting != nil {
			waiting.reply <- answerOf(frame)
		}
		return
	}
	// a frame of a later gateway
	c.mu.Unlock()
}

func answerOf(frame *frame) reply {
	if frame.ok {
		return reply{value: frame.value}
	}
	refused, err := decode[ErrorReply](frame.failure)
	if err != nil {
		return reply{err: err}
	}
	return reply{err: refusal(refused)}
}

// write sends a frame. What cannot be sent breaks the connection, and is sent by the next one.
func (c *Client) write(conn *websocket.Conn, frame map[string]any) {
	payload, err := msgpack.Marshal(frame)
	if err == nil {
		ctx, cancel := context.WithTimeout(context.Background(), writeTimeout)
		err = conn.Write(ctx, websocket.MessageBinary, payload)
		cancel()
	}
	if err != nil {
		_ = conn.CloseNow()
	}
}

func (c *Client) unreachable(err error) error {
	if errors.Is(err, context.Canceled) {
		return err
	}
	return unreachable(CodeNobodyAnswers, fmt.Sprintf("the gateway at %s refuses the connection or is not there: %v", c.url, err), "is it running, and is the token right?")
}

func closedError() error {
	return &UnreachableError{&Error{Code: CodeClientClosed, Message: "the client has been closed"}}
}

// frame is what comes from the gateway.
type frame struct {
	op                    string
	id                    int64
	ok                    bool
	value, failure        msgpack.RawMessage
	message               msgpack.RawMessage
	client, session, role string
	resumed               bool
}

func readFrame(payload []byte) (*frame, error) {
	decoder := msgpack.NewDecoder(bytes.NewReader(payload))
	count, err := decoder.DecodeMapLen()
	if err != nil {
		return nil, err
	}
	made := &frame{}
	for range count {
		key, err := decoder.DecodeString()
		if err != nil {
			return nil, err
		}
		switch key {
		case "op":
			made.op, err = decoder.DecodeString()
		case "id":
			made.id, err = decoder.DecodeInt64()
		case "ok":
			made.ok, err = decoder.DecodeBool()
		case "value":
			made.value, err = decoder.DecodeRaw()
		case "error":
			made.failure, err = decoder.DecodeRaw()
		case "message":
			made.message, err = decoder.DecodeRaw()
		case "client":
			made.client, err = decoder.DecodeString()
		case "session":
			made.session, err = decoder.DecodeString()
		case "role":
			made.role, err = decoder.DecodeString()
		case "resumed":
			made.resumed, err = decoder.DecodeBool()
		default:
			err = decoder.Skip()
		}
		if err != nil {
			return nil, err
		}
	}
	return made, nil
}
