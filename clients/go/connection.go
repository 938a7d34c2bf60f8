package mcclient

import (
	"context"
	"errors"
	"fmt"
	"net/http"
	"net/url"
	"time"

	"github.com/coder/websocket"
	"github.com/vmihailenco/msgpack/v5"
)

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
		if lost && each.sent && !repeatable[each.method] && each.frame["op"] == "call" {
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
			// a peer that writes what is no frame is not a gateway
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
