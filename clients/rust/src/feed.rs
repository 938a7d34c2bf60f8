//! What arrives, for one reader: bounded, the oldest goes first.

use std::any::Any;
use std::collections::VecDeque;
use std::fmt;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};

use futures_core::Stream;

use crate::presence::lock;

struct Waiting<T> {
    items: VecDeque<T>,
    missed: u64,
    closed: bool,
    reader: Option<Waker>,
}

/// The writer's end; it may be cloned.
pub(crate) struct Queue<T> {
    waiting: Arc<Mutex<Waiting<T>>>,
    limit: usize,
}

impl<T> Clone for Queue<T> {
    fn clone(&self) -> Self {
        Self {
            waiting: Arc::clone(&self.waiting),
            limit: self.limit,
        }
    }
}

impl<T> Queue<T> {
    pub fn new(limit: usize) -> Self {
        Self {
            waiting: Arc::new(Mutex::new(Waiting {
                items: VecDeque::new(),
                missed: 0,
                closed: false,
                reader: None,
            })),
            limit,
        }
    }

    /// Appends an item; when it is full the oldest goes. From any thread, and never waits.
    pub fn push(&self, item: T) {
        self.wake(|waiting| {
            if waiting.closed {
                return;
            }
            if waiting.items.len() >= self.limit {
                waiting.items.pop_front();
                waiting.missed += 1;
            }
            waiting.items.push_back(item);
        });
    }

    /// Counts items that are lost on the way.
    pub fn miss(&self, count: u64) {
        lock(&self.waiting).missed += count;
    }

    /// No more comes; what is there can still be read.
    pub fn end(&self) {
        self.wake(|waiting| waiting.closed = true);
    }

    pub fn poll_next(&self, context: &Context<'_>) -> Poll<Option<T>> {
        let mut waiting = lock(&self.waiting);
        if let Some(item) = waiting.items.pop_front() {
            return Poll::Ready(Some(item));
        }
        if waiting.closed {
            return Poll::Ready(None);
        }
        waiting.reader = Some(context.waker().clone());
        Poll::Pending
    }

    pub async fn next(&self) -> Option<T> {
        std::future::poll_fn(|context| self.poll_next(context)).await
    }

    fn wake(&self, change: impl FnOnce(&mut Waiting<T>)) {
        let reader = {
            let mut waiting = lock(&self.waiting);
            change(&mut waiting);
            waiting.reader.take()
        };
        if let Some(reader) = reader {
            reader.wake();
        }
    }
}

/// A stream of what arrives; it listens from its making on until it is dropped.
///
/// It is bounded: of what a reader is too slow for the oldest is lost, and [`Feed::missed`] counts it. Read it with
/// [`Feed::next`], or as a [`Stream`].
pub struct Feed<T> {
    queue: Queue<T>,
    _source: Box<dyn Any + Send + Sync>,
}

impl<T> Feed<T> {
    /// `source` ends when the feed is dropped.
    pub(crate) fn new(queue: Queue<T>, source: impl Any + Send + Sync) -> Self {
        Self {
            queue,
            _source: Box::new(source),
        }
    }

    /// Returns the next item; none: no more will come.
    pub async fn next(&mut self) -> Option<T> {
        self.queue.next().await
    }

    /// Counts the items that came faster than they were read, and are lost.
    #[must_use]
    pub fn missed(&self) -> u64 {
        lock(&self.queue.waiting).missed
    }
}

impl<T> Stream for Feed<T> {
    type Item = T;

    fn poll_next(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<T>> {
        self.queue.poll_next(context)
    }
}

impl<T> fmt::Debug for Feed<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Feed").field("missed", &self.missed()).finish_non_exhaustive()
    }
}

impl<T> Drop for Feed<T> {
    fn drop(&mut self) {
        self.queue.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_slow_reader_gets_the_newest_and_the_count_of_what_it_lost() {
        let queue = Queue::new(3);
        let mut feed = Feed::new(queue.clone(), ());
        for item in 0..10 {
            queue.push(item);
        }
        queue.end();
        queue.push(99);
        let mut read = Vec::new();
        while let Some(item) = feed.next().await {
            read.push(item);
        }
        assert_eq!((read, feed.missed()), (vec![7, 8, 9], 7));
    }

    #[tokio::test]
    async fn a_reader_that_waits_is_woken_by_an_item_and_by_the_end() {
        let queue = Queue::new(3);
        let mut feed = Feed::new(queue.clone(), ());
        let reader = tokio::spawn(async move { (feed.next().await, feed.next().await) });
        tokio::task::yield_now().await;
        queue.push(1);
        tokio::task::yield_now().await;
        queue.end();
        assert_eq!(reader.await.unwrap(), (Some(1), None));
    }
}
