//! A device's thread: what it is told, and what it answers.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use super::Opener;
use crate::foveation::Part;
use crate::trace::worker::{Job, PartResult};

/// A failed device is tried again after this time, which doubles with each failure.
const RETRY: Duration = Duration::from_millis(500);
const RETRY_LONGEST: Duration = Duration::from_secs(60);

/// Parts of views that follow each other, with the rounds that they belong to.
#[derive(Default)]
pub(super) struct Order {
    pub rounds: Vec<u64>,
    pub work: Vec<(Arc<Job>, Part)>,
}

pub(super) enum Answer {
    /// What the operator should know of it, or why it cannot be used.
    Opened(std::result::Result<Option<String>, String>),
    /// The round that it belongs to, how long it took since the order or the answer before, and the result. After a
    /// failure nothing is left of the order.
    Traced(u64, Duration, std::result::Result<Box<PartResult>, String>),
}

/// A device's thread: ends when nobody is left to give orders.
pub(super) fn work(index: usize, open: &Opener, orders: &Receiver<Order>, answer: &Sender<(usize, Answer)>) {
    let mut pause = RETRY;
    for times in 0.. {
        let opened = open(times);
        let told = opened.as_ref().map(|worker| worker.note()).map_err(ToString::to_string);
        if answer.send((index, Answer::Opened(told))).is_err() {
            return;
        }
        if let Ok(mut worker) = opened {
            loop {
                let Ok(order) = orders.recv() else { return };
                let (mut since, mut rounds) = (Instant::now(), order.rounds.into_iter());
                let (mut failed, mut heard) = (false, true);
                worker.trace_all(&order.work, &mut |traced| {
                    let Some(round) = rounds.next() else { return };
                    failed |= traced.is_err();
                    let told = traced.map(Box::new).map_err(|error| error.to_string());
                    let took = std::mem::replace(&mut since, Instant::now()).elapsed();
                    heard &= answer.send((index, Answer::Traced(round, took, told))).is_ok();
                });
                if !heard {
                    return;
                }
                if failed {
                    if worker.is_lost() {
                        std::mem::forget(worker);
                    }
                    break;
                }
                pause = RETRY;
            }
        } else if times == 0 {
            // What cannot be used at the start is left out for good.
            return;
        }
        let until = Instant::now() + pause;
        pause = (pause * 2).min(RETRY_LONGEST);
        loop {
            match orders.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => break,
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }
}
