package mcclient

import (
	"context"
	"sync"
)

// Events is what happens from now on, in order and without a gap: what was lost with a connection is asked for again. The first events of another
// start of the server come with another Instance.
func (m *Machine) Events(ctx context.Context) (*Feed[*Event], error) {
	page, err := m.eventsSince(ctx, 1<<52, 1)
	if err != nil {
		return nil, err
	}
	running, stop := context.WithCancel(context.Background())
	order := &eventOrder{
		feed: newFeed[*Event](eventLimit), instance: page.Instance, last: page.Newest, ask: make(chan struct{}, 1),
	}
	unsubscribe, err := m.client.listen(ctx, &topic{
		machine: m.name,
		name:    "events",
		deliver: func(payload []byte) {
			if event, err := decode[Event](payload); err == nil {
				order.take(event)
			}
		},
		resumed: order.catchUp,
		ended: func(err error) {
			stop()
			order.feed.end(err)
		},
	})
	if err != nil {
		stop()
		return nil, err
	}
	order.feed.release = func() {
		stop()
		unsubscribe()
	}
	go order.recover(running, m)
	return order.feed, nil
}

func (m *Machine) eventsSince(ctx context.Context, since int64, limit int) (*EventsReply, error) {
	return m.PastEvents(ctx, EventsRequest{Since: since, Limit: Ptr(int64(limit))})
}

// eventOrder puts events in order; a gap is asked for.
type eventOrder struct {
	mu       sync.Mutex
	feed     *Feed[*Event]
	instance string
	last     int64
	ask      chan struct{}
}

func (o *eventOrder) catchUp() {
	select {
	case o.ask <- struct{}{}:
	default:
	}
}

func (o *eventOrder) take(event *Event) {
	o.mu.Lock()
	defer o.mu.Unlock()
	if event.Instance != o.instance {
		// another start of the server, whose numbers begin with 1
		o.instance, o.last = event.Instance, 0
	}
	switch {
	case event.Seq == o.last+1:
		o.last = event.Seq
		o.feed.push(event)
	case event.Seq > o.last:
		o.catchUp()
	}
}

// recover asks for what is missing, page by page.
func (o *eventOrder) recover(ctx context.Context, m *Machine) {
	for {
		select {
		case <-ctx.Done():
			return
		case <-o.ask:
		}
		for {
			o.mu.Lock()
			since := o.last + 1
			o.mu.Unlock()
			page, err := m.eventsSince(ctx, since, eventPage)
			if err != nil || len(page.Events) == 0 {
				break
			}
			o.mu.Lock()
			if page.Instance == o.instance && page.Oldest > o.last+1 {
				// the server has them no more
				o.last = page.Oldest - 1
			}
			o.mu.Unlock()
			for i := range page.Events {
				o.take(&page.Events[i])
			}
			if len(page.Events) < eventPage {
				break
			}
		}
	}
}
