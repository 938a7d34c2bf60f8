//! Events in order and without gap: what the network lost is asked for again by its number.

use std::collections::BTreeMap;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::sleep;

use crate::calls::{Caller, Trying};
use crate::error::Result;
use crate::feed::Queue;
use crate::messages::{Event, EventsReply, EventsRequest};
use crate::wire::decode;

pub(crate) const EVENTS_LIMIT: usize = 20_000;
const WAITING_LIMIT: usize = 5000;
const EVENTS_A_PAGE: u64 = 1000;
/// After so long a silence the server is asked whether the last events were lost.
const SILENCE: Duration = Duration::from_secs(2);
/// Beyond all numbers: an answer without events that says which the newest one is.
pub(crate) const NEWEST: u64 = 1 << 52;

/// Asks the server for its events from number `since` on.
pub(crate) async fn fetch(caller: &Caller, since: u64) -> Result<EventsReply> {
    let limit = if since >= NEWEST { 1 } else { EVENTS_A_PAGE };
    let payload = caller.call("events", &EventsRequest { since, limit }, Trying::default()).await?;
    decode(&payload)
}

/// Puts events in order; a state machine without I/O.
#[derive(Debug, Default)]
pub(crate) struct EventOrder {
    /// Events that are lost for good.
    pub missed: u64,
    instance: Option<String>,
    former: Option<String>,
    next: u64,
    waiting: BTreeMap<u64, Event>,
}

impl EventOrder {
    /// Begins behind the newest event of this page.
    pub fn behind(page: &EventsReply) -> Self {
        Self {
            instance: Some(page.instance.clone()),
            next: page.newest + 1,
            ..Self::default()
        }
    }

    /// Number from which events have to be asked for; none: nothing is known to be missing.
    pub fn gap(&self) -> Option<u64> {
        (!self.waiting.is_empty()).then_some(self.next)
    }

    /// The next number that is expected.
    pub fn next(&self) -> u64 {
        self.next
    }

    /// Returns what may be passed on now that this event has arrived.
    pub fn take(&mut self, event: Event) -> Vec<Event> {
        if self.former.as_ref() == Some(&event.instance) {
            return Vec::new();
        }
        self.turn_to(&event.instance);
        if event.seq >= self.next && self.waiting.len() < WAITING_LIMIT {
            self.waiting.insert(event.seq, event);
        }
        self.in_order()
    }

    /// Returns what may be passed on now that the server has said its events again.
    pub fn fill(&mut self, page: EventsReply) -> Vec<Event> {
        if self.former.as_ref() == Some(&page.instance) {
            return Vec::new();
        }
        self.turn_to(&page.instance);
        if page.oldest > self.next {
            // the server no longer has them; the first start of a count is no loss
            if self.next > 0 {
                self.missed += page.oldest - self.next;
            }
            self.next = page.oldest;
        }
        for event in page.events {
            if event.seq >= self.next && event.instance == page.instance {
                self.waiting.insert(event.seq, event);
            }
        }
        self.in_order()
    }

    /// The gap cannot be closed: goes on behind it.
    pub fn give_up(&mut self) -> Vec<Event> {
        if let Some((&first, _)) = self.waiting.first_key_value() {
            self.missed += first - self.next;
            self.next = first;
        }
        self.in_order()
    }

    /// A new start of the server counts from its own beginning.
    fn turn_to(&mut self, instance: &str) {
        if self.instance.as_deref() == Some(instance) {
            return;
        }
        if self.instance.is_some() {
            self.next = 0;
            self.waiting.clear();
        }
        self.former = self.instance.replace(instance.to_owned());
    }

    fn in_order(&mut self) -> Vec<Event> {
        let mut ready = Vec::new();
        while let Some(event) = self.waiting.remove(&self.next) {
            self.next += 1;
            ready.push(event);
        }
        ready
    }
}

/// Passes events on in order and asks for what is missing, for as long as it is polled.
pub(crate) async fn read_events(
    arrived: Queue<Event>,
    mut order: EventOrder,
    caller: Caller,
    mut returns: watch::Receiver<u64>,
    mut pass_on: impl FnMut(Event),
    missed: impl Fn(u64),
    history: bool,
) {
    let mut ask = history;
    loop {
        if !ask {
            tokio::select! {
                event = arrived.next() => match event {
                    Some(event) => order.take(event).into_iter().for_each(&mut pass_on),
                    None => return,
                },
                changed = returns.changed() => match changed {
                    Ok(()) => ask = true,
                    Err(_) => return,
                },
                () = sleep(SILENCE) => ask = true,
            }
        }
        if ask || order.gap().is_some() {
            close_gap(&mut order, &caller, &mut pass_on).await;
            ask = false;
        }
        if order.missed > 0 {
            missed(std::mem::take(&mut order.missed));
        }
    }
}

async fn close_gap(order: &mut EventOrder, caller: &Caller, pass_on: &mut impl FnMut(Event)) {
    loop {
        let page = match fetch(caller, order.next()).await {
            Ok(page) => page,
            Err(error) => {
                tracing::debug!("events could not be asked for again: {error}");
                order.give_up().into_iter().for_each(pass_on);
                return;
            }
        };
        let last = page.events.last().map_or(page.newest, |event| event.seq);
        let more = last < page.newest && !page.events.is_empty();
        order.fill(page).into_iter().for_each(&mut *pass_on);
        if more {
            continue;
        }
        if order.gap().is_none() {
            return;
        }
        // the server has been asked and did not close it
        order.give_up().into_iter().for_each(&mut *pass_on);
        if order.gap().is_none() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(instance: &str, seq: u64) -> Event {
        crate::wire::decode(
            &crate::wire::encode(
                &serde_json::json!({"seq": seq, "t": 0.5, "instance": instance, "kind": "reset"}),
            )
            .unwrap(),
        )
        .unwrap()
    }

    fn page(instance: &str, oldest: u64, newest: u64, numbers: &[u64]) -> EventsReply {
        EventsReply {
            instance: instance.to_owned(),
            oldest,
            newest,
            events: numbers.iter().map(|&seq| event(instance, seq)).collect(),
        }
    }

    fn numbers(events: &[Event]) -> Vec<u64> {
        events.iter().map(|each| each.seq).collect()
    }

    fn behind(newest: u64) -> EventOrder {
        EventOrder::behind(&page("a", 1, newest, &[]))
    }

    #[test]
    fn events_that_come_out_of_order_and_twice_are_passed_on_once_and_in_order() {
        let mut order = behind(4);
        assert!(order.take(event("a", 7)).is_empty());
        assert_eq!(order.gap(), Some(5));
        assert!(order.take(event("a", 6)).is_empty());
        assert_eq!(numbers(&order.take(event("a", 5))), [5, 6, 7]);
        assert!(order.take(event("a", 6)).is_empty());
        assert_eq!(order.gap(), None);
    }

    #[test]
    fn a_page_closes_the_gap_and_what_the_server_no_longer_has_is_counted() {
        let mut order = behind(4);
        assert!(order.take(event("a", 9)).is_empty());
        assert_eq!(numbers(&order.fill(page("a", 7, 9, &[7, 8, 9]))), [7, 8, 9]);
        assert_eq!(order.missed, 2);
    }

    #[test]
    fn a_gap_that_cannot_be_closed_is_counted_and_passed() {
        let mut order = behind(4);
        assert!(order.take(event("a", 8)).is_empty());
        assert_eq!(numbers(&order.give_up()), [8]);
        assert_eq!((order.missed, order.gap()), (3, None));
    }

    #[test]
    fn a_new_start_of_the_server_counts_anew_and_the_former_one_is_not_heard_any_more() {
        let mut order = behind(40);
        assert_eq!(numbers(&order.fill(page("b", 1, 2, &[1, 2]))), [1, 2]);
        assert!(order.take(event("a", 41)).is_empty());
        assert!(order.fill(page("a", 1, 41, &[41])).is_empty());
        assert_eq!(numbers(&order.take(event("b", 3))), [3]);
        assert_eq!(order.missed, 0);
    }
}
