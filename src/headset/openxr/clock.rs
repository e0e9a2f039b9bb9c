//! The runtime's times, checked before they are believed.

/// Nanoseconds of the longest period that is believed: 1 Hz.
const LONGEST_PERIOD: i64 = 1_000_000_000;
/// Nanoseconds of the shortest: 1 kHz.
const SHORTEST_PERIOD: i64 = 1_000_000;
/// The period as long as none was told that is believed: 90 Hz.
const USUAL_PERIOD: i64 = 11_111_111;
/// Display times that come more than this much earlier or later than expected are those of a clock that was
/// set, and are believed at once, unless it is the clock that the runtime lends: that one is never set.
const CLOCK_SET: i64 = 15_000_000_000;
/// How many periods a display time may come earlier or later than expected.
const LEEWAY_PERIODS: i64 = 8;
/// The same in nanoseconds, where periods are long.
const LEEWAY: i64 = 200_000_000;
/// Unexpected display times in a row, in keeping with each other, after which they are believed.
const CONSISTENT: u32 = 3;

/// What xrWaitFrame has told of a frame, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Told {
    /// The predicted display time.
    pub time: i64,
    /// The predicted display period.
    pub period: i64,
    /// A steady clock's reading as xrWaitFrame returned.
    pub arrived: i64,
}

/// Follows predicted display times: gives poses a time to be asked for, and counts what was dropped.
///
/// Runtimes have been seen to predict wrong periods in their first frames, and times that are negative,
/// stand still, jump ahead or go back. What is told is compared with what was told before and with a steady
/// clock that is read as xrWaitFrame returns: the time from there to the display, the lead, hardly changes.
/// A display time with another lead is replaced by what the usual lead says. If the next ones have that lead
/// too, or the clock was clearly set, it is the usual one from then on. What was put in the place of a told
/// time is compared with nothing and counted nowhere.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameClock {
    /// The steady clock is the runtime's own, so that leads are true distances.
    lent: bool,
    period: Option<i64>,
    /// From the arrival of the last frame that was believed to its display.
    lead: Option<i64>,
    /// A lead that is not believed yet, and for how many frames it was told.
    rival: Option<(i64, u32)>,
    /// The newest display time that was told, believed or not.
    told: Option<i64>,
    /// The newest that was believed.
    believed: Option<i64>,
    /// The same since the last pause, and how many frames came after it.
    counted: Option<(i64, i64)>,
    /// Display periods that went by without a new picture, so far.
    pub dropped: u64,
    /// Times that were not believed, so far.
    pub doubted: u64,
}

impl FrameClock {
    /// A clock that is compared with the runtime's own where the runtime lends it, else with any steady one.
    pub fn new(lent: bool) -> Self {
        FrameClock { lent, ..FrameClock::default() }
    }

    /// Takes what was told of a frame; returns when it will be displayed, which is positive.
    pub fn frame(&mut self, told: Told) -> i64 {
        if (SHORTEST_PERIOD..=LONGEST_PERIOD).contains(&told.period) {
            self.period = Some(told.period);
        }
        let lead = told.time.saturating_sub(told.arrived);
        let believed = told.time > 0 && self.believes(told.time, lead);
        if told.time > 0 {
            self.told = Some(told.time);
        }
        if !believed {
            self.doubted += 1;
            self.counted = self.counted.map(|(time, after)| (time, after + 1));
            let lead = self.lead.unwrap_or(self.step());
            return told.arrived.saturating_add(lead).max(1);
        }
        self.count(told.time, lead);
        (self.lead, self.rival, self.believed) = (Some(lead), None, Some(told.time));
        told.time
    }

    /// Whether a display time is believed.
    fn believes(&mut self, time: i64, lead: i64) -> bool {
        let stands = self.told == Some(time);
        let plausible = self.lent && self.is_plausible(lead);
        let Some(usual) = self.lead else { return plausible || !self.lent || self.is_again(time, lead) };
        let off = lead.abs_diff(usual);
        if self.within(off as i64) {
            return self.believed.is_none_or(|last| time > last);
        }
        if (off > CLOCK_SET as u64 && !self.lent) || plausible {
            return !stands;
        }
        self.is_again(time, lead)
    }

    /// Whether an unexpected lead was told often enough.
    fn is_again(&mut self, time: i64, lead: i64) -> bool {
        let advances = self.told.is_none_or(|last| time > last);
        let again = self.rival.filter(|(rival, _)| advances && self.within(lead.abs_diff(*rival) as i64));
        let times = again.map_or(1, |(_, times)| times + 1);
        self.rival = Some((lead, times));
        times >= CONSISTENT
    }

    fn within(&self, off: i64) -> bool {
        let step = self.step();
        (0..=(step * LEEWAY_PERIODS).min(LEEWAY).max(step * 2)).contains(&off)
    }

    /// Whether a true distance from now to the display is one that displays have.
    fn is_plausible(&self, lead: i64) -> bool {
        lead > -self.step() && self.within(lead.max(0))
    }

    /// Counts the periods since the last time that was believed in which there was no frame, unless the clock
    /// was set in between.
    fn count(&mut self, time: i64, lead: i64) {
        let same_clock = self.lead.is_some_and(|usual| self.within(lead.abs_diff(usual) as i64));
        if let Some((last, after)) = self.counted.filter(|_| same_clock) {
            let periods = time.saturating_sub(last).saturating_add(self.step() / 2) / self.step();
            self.dropped += periods.saturating_sub(1 + after).max(0) as u64;
        }
        self.counted = Some((time, 0));
    }

    /// Nanoseconds between pictures, once the runtime has told a believable number.
    pub fn period(&self) -> Option<i64> {
        self.period
    }

    /// The same, or what is usual as long as it is unknown.
    pub fn step(&self) -> i64 {
        self.period.unwrap_or(USUAL_PERIOD)
    }

    /// A reading of the steady clock as a time of the display's. A clock that is not the display's own is
    /// taken to be read one period before the display as a frame arrives.
    pub fn now(&self, reading: i64) -> i64 {
        match self.lead {
            Some(lead) if !(self.lent && self.is_plausible(lead)) => {
                reading.saturating_add(lead).saturating_sub(self.step())
            }
            _ => reading,
        }
    }

    /// After a pause the next frame's gap is nobody's fault.
    pub fn pause(&mut self) {
        self.counted = None;
    }
}

#[cfg(test)]
mod tests;
