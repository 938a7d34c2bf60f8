package mcclient

import (
	"context"
	"iter"
	"sync"
)

// Feed is what arrives, in order. It is bounded: a reader that is too slow loses the oldest.
type Feed[T any] struct {
	mu      sync.Mutex
	items   []T
	limit   int
	missed  int64
	err     error
	ended   bool
	arrived chan struct{}
	release func()
}

func newFeed[T any](limit int) *Feed[T] {
	return &Feed[T]{limit: limit, arrived: make(chan struct{}, 1), release: func() {}}
}

// All yields what arrives until the context is done, the feed is closed or the client is; the loop may be left at any time, and another
// one goes on behind it.
func (f *Feed[T]) All(ctx context.Context) iter.Seq[T] {
	return func(yield func(T) bool) {
		for {
			item, err := f.Next(ctx)
			if err != nil || !yield(item) {
				return
			}
		}
	}
}

// Next waits for the next item. It fails when the context is done, and with an error that says why the feed has ended.
func (f *Feed[T]) Next(ctx context.Context) (T, error) {
	for {
		f.mu.Lock()
		if len(f.items) > 0 {
			item := f.items[0]
			f.items = f.items[1:]
			f.mu.Unlock()
			return item, nil
		}
		ended, err := f.ended, f.err
		f.mu.Unlock()
		var none T
		if ended {
			f.wake()
			return none, err
		}
		select {
		case <-ctx.Done():
			return none, ctx.Err()
		case <-f.arrived:
		}
	}
}

// Missed counts what came faster than it was read, and is lost.
func (f *Feed[T]) Missed() int64 {
	f.mu.Lock()
	defer f.mu.Unlock()
	return f.missed
}

// Close stops listening; what is there can still be read.
func (f *Feed[T]) Close() {
	f.release()
	f.end(&Error{Code: CodeClientClosed, Message: "the feed has been closed"})
}

func (f *Feed[T]) push(item T) {
	f.mu.Lock()
	if f.ended {
		f.mu.Unlock()
		return
	}
	if len(f.items) >= f.limit {
		f.items = f.items[1:]
		f.missed++
	}
	f.items = append(f.items, item)
	f.mu.Unlock()
	f.wake()
}

func (f *Feed[T]) end(err error) {
	f.mu.Lock()
	if !f.ended {
		f.ended, f.err = true, err
	}
	f.mu.Unlock()
	f.wake()
}

func (f *Feed[T]) wake() {
	select {
	case f.arrived <- struct{}{}:
	default:
	}
}
