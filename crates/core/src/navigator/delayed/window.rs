//! What was handed over within the lag, in its order, with snapshots in between.

use std::cmp::Ordering;
use std::collections::VecDeque;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::event::{Class, Event};

/// Snapshots in a lag.
const MARKS: i64 = 8;
/// They lie no closer than this, ns.
const LEAST_SPACING_NS: i64 = 250_000_000;
/// Steps and bytes of snapshots that are kept at most; a source that floods the window shortens it.
const MOST_STEPS: usize = 200_000;
const MOST_BYTES: usize = 256 << 20;

/// One thing that the navigator was handed.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum Step {
    /// An event.
    Event(Event),
    /// The request for a packet.
    Launch {
        tol_ns: i64,
        capacity_bytes: usize,
        /// What went on the air.
        sent: Option<Arc<[u8]>>,
        /// Whether the navigator would send something else by now.
        outdated: bool,
    },
}

impl Step {
    pub fn t_ns(&self) -> i64 {
        match self {
            Self::Event(event) => event.t_ns,
            Self::Launch { tol_ns, .. } => *tol_ns,
        }
    }

    fn class(&self) -> Class {
        match self {
            Self::Event(event) => event.payload.class(),
            Self::Launch { .. } => Class::Transmit,
        }
    }

    pub fn order(&self, other: &Self) -> Ordering {
        match (self, other) {
            (Self::Event(a), Self::Event(b)) => a.order(b),
            _ => (self.t_ns(), self.class()).cmp(&(other.t_ns(), other.class())),
        }
    }
}

/// The navigator as it was before one of the steps.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Mark {
    /// Number of that step, counted from the first that there ever was.
    before: u64,
    /// Its time, ns.
    t_ns: i64,
    snapshot: Vec<u8>,
}

/// Steps in their order; the first mark stands before the first step.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Window {
    steps: VecDeque<Step>,
    marks: VecDeque<Mark>,
    /// Number of the first step that is kept.
    first: u64,
    /// Time of the newest event, and of the newest step that is not kept any more, ns.
    newest_ns: Option<i64>,
    floor_ns: Option<i64>,
    /// Late events that took their place, and those that came too late.
    pub replayed: u64,
    pub rejected: u64,
    /// Packets on the air that would be others by now.
    pub outdated: u64,
}

impl Window {
    /// Refuses a window out of a snapshot whose numbers do not fit each other.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check(&self) -> Result<(), Error> {
        let begins = self.marks.front().map_or(self.steps.is_empty(), |mark| mark.before == self.first);
        let within = self.marks.iter().all(|mark| (self.first..=self.end()).contains(&mark.before));
        if begins && within && self.marks.iter().map(|mark| mark.before).is_sorted() {
            return Ok(());
        }
        Err(Error::Snapshot("its window of late events contradicts itself".into()))
    }

    /// Whether the window reaches back to `t_ns`.
    pub fn reaches(&self, t_ns: i64, lag_ns: i64) -> bool {
        let kept = self.floor_ns.is_none_or(|floor_ns| t_ns > floor_ns);
        kept && self.newest_ns.is_none_or(|newest_ns| t_ns >= newest_ns.saturating_sub(lag_ns))
    }

    /// Where a step belongs; `None`: after all that there are.
    pub fn place(&self, step: &Step) -> Option<usize> {
        if self.steps.back().is_none_or(|last| last.order(step) != Ordering::Greater) {
            return None;
        }
        Some(self.steps.partition_point(|kept| kept.order(step) != Ordering::Greater))
    }

    /// Whether a snapshot is due before the next step, which is of this time.
    pub fn wants_mark(&self, t_ns: i64, lag_ns: i64) -> bool {
        let Some(last) = self.marks.back() else { return true };
        let since = self.end().saturating_sub(last.before);
        let spacing_ns = (lag_ns / MARKS).max(LEAST_SPACING_NS);
        t_ns.saturating_sub(last.t_ns) >= spacing_ns || since >= MOST_STEPS as u64 / MARKS as u64
    }

    fn end(&self) -> u64 {
        self.first.saturating_add(self.steps.len() as u64)
    }

    /// Appends a step, with a snapshot from before it.
    pub fn push(&mut self, step: Step, snapshot: Option<Vec<u8>>, lag_ns: i64) {
        if let Some(snapshot) = snapshot {
            self.marks.push_back(Mark { before: self.end(), t_ns: step.t_ns(), snapshot });
        }
        if let Step::Event(event) = &step {
            self.newest_ns = Some(self.newest_ns.map_or(event.t_ns, |newest_ns| newest_ns.max(event.t_ns)));
        }
        self.steps.push_back(step);
        self.forget(lag_ns);
    }

    /// Gives up what no late event can need.
    fn forget(&mut self, lag_ns: i64) {
        let Some(newest_ns) = self.newest_ns else { return };
        while let Some(second) = self.marks.get(1) {
            let steps = (second.before - self.first) as usize;
            let last_ns = steps.checked_sub(1).and_then(|last| self.steps.get(last)).map(Step::t_ns);
            let old = last_ns.is_some_and(|t_ns| t_ns < newest_ns.saturating_sub(lag_ns));
            if !old && self.steps.len() <= MOST_STEPS {
                break;
            }
            self.first = second.before;
            self.floor_ns = last_ns.max(self.floor_ns);
            self.steps.drain(..steps);
            self.marks.pop_front();
        }
        let bytes = |marks: &VecDeque<Mark>| marks.iter().map(|mark| mark.snapshot.len()).sum::<usize>();
        while self.marks.len() > 2 && bytes(&self.marks) > MOST_BYTES {
            // More is done again from further back.
            self.marks.remove(1);
        }
    }

    /// The last snapshot from before the step at `at`, and the steps from there to it.
    pub fn before(&mut self, at: usize) -> Option<(&[u8], impl Iterator<Item = &mut Step>)> {
        let number = self.first + at as u64;
        let mark = self.marks.iter().rev().find(|mark| mark.before <= number)?;
        let from = (mark.before - self.first) as usize;
        Some((&mark.snapshot, self.steps.range_mut(from..at)))
    }

    /// Takes out the steps from `at` on; their snapshots hold no longer.
    pub fn cut(&mut self, at: usize) -> VecDeque<Step> {
        let number = self.first + at as u64;
        self.marks.retain(|mark| mark.before <= number);
        self.steps.split_off(at)
    }
}
