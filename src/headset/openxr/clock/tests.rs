use proptest::prelude::*;

use super::*;

const PERIOD: i64 = 10_000_000;
/// A steady clock that is not the runtime's is off by anything.
const ELSEWHERE: i64 = -7_000_000_000_000;

/// A display that shows a picture each period, and a runtime that tells so a period ahead.
struct World {
    clock: FrameClock,
    start: i64,
    period: i64,
    elsewhere: i64,
}

impl World {
    fn new(lent: bool) -> Self {
        let elsewhere = if lent { 0 } else { ELSEWHERE };
        World { clock: FrameClock::new(lent), start: 50_000_000_000, period: PERIOD, elsewhere }
    }

    /// The frame's true display time, and how far off it was taken to be where the runtime told another.
    fn frame(&mut self, tell: impl Fn(i64) -> i64) -> i64 {
        self.start += self.period;
        let arrived = self.start - self.period + self.elsewhere;
        self.clock.frame(Told { time: tell(self.start), period: self.period, arrived }) - self.start
    }

    fn steadily(&mut self, frames: usize) {
        (0..frames).for_each(|_| assert_eq!(self.frame(|time| time), 0));
    }
}

fn worlds() -> [World; 2] {
    [World::new(true), World::new(false)]
}

#[test]
fn gaps_are_dropped_frames() {
    for mut world in worlds() {
        world.steadily(3);
        for (missed, dropped) in [(0, 0), (1, 1), (0, 1), (3, 4), (150, 154)] {
            world.start += missed * PERIOD;
            assert_eq!(world.frame(|time| time), 0);
            assert_eq!(world.clock.dropped, dropped);
        }
        world.clock.pause();
        world.start += 500 * PERIOD;
        world.steadily(1);
        assert_eq!((world.clock.dropped, world.clock.doubted), (154, 0));
    }
}

#[test]
fn wrong_times_are_replaced_and_forgotten() {
    for mut world in worlds() {
        world.steadily(1);
        let last = world.start;
        let wrongs: [&dyn Fn(i64) -> i64; 11] = [
            &|_| last,
            &|_| last - PERIOD,
            &|_| -5,
            &|_| 0,
            &|_| i64::MIN,
            &|_| last - 7,
            &|time| time + 2_000_000_000,
            &|time| time - 300_000_000,
            &|time| time + 10_500_000_000,
            &|time| time - 10_500_000_000,
            &|_| 0,
        ];
        for (index, wrong) in wrongs.into_iter().enumerate() {
            assert_eq!(world.frame(wrong), 0, "{index}");
        }
        assert_eq!((world.clock.doubted, world.clock.dropped), (11, 0));
        world.steadily(5);
        assert_eq!((world.clock.doubted, world.clock.dropped), (11, 0));
    }
}

#[test]
fn a_clock_that_was_set_is_followed_at_once() {
    let jumps = [1_000_000_000_000, 0, 20_000_000_000i64, 0, -30_000_000_000, 0];
    let [mut lent, mut other] = worlds();
    for world in [&mut lent, &mut other] {
        world.steadily(2);
    }
    for jump in jumps {
        assert_eq!(other.frame(|time| time + jump), jump);
        // Nobody sets the clock that the runtime lends: its times are wrong ones.
        assert_eq!(lent.frame(|time| time + jump), 0);
    }
    assert_eq!((lent.clock.dropped, other.clock.dropped), (0, 0));
}

#[test]
fn what_stays_is_believed_in_the_third_frame() {
    for (mut world, jump) in worlds().into_iter().zip([500_000_000, -500_000_000]) {
        world.steadily(5);
        for off in [0, 0, jump, jump, jump] {
            assert_eq!(world.frame(|time| time + jump), off);
        }
        // Now is a period before the display, as it was.
        let reading = world.start - PERIOD + world.elsewhere;
        assert_eq!(world.clock.now(reading), world.start + jump - PERIOD);
        assert_eq!(world.clock.dropped, 0);
    }
}

#[test]
fn a_time_that_stands_still_is_never_believed() {
    for mut world in worlds() {
        world.steadily(3);
        let stopped = world.start;
        (0..2000).for_each(|_| assert_eq!(world.frame(|_| stopped), 0));
        world.steadily(3);
    }
}

#[test]
fn absurd_values_do_no_harm() {
    for lent in [false, true] {
        let mut clock = FrameClock::new(lent);
        for time in [i64::MIN, i64::MAX, -1, 0, 1, i64::MAX, i64::MAX, i64::MIN] {
            for period in [i64::MIN, 0, i64::MAX, 1] {
                for arrived in [i64::MIN, 0, i64::MAX] {
                    assert!(clock.frame(Told { time, period, arrived }) > 0);
                    clock.now(arrived);
                }
            }
        }
        assert_eq!(clock.period(), None);
    }
}

/// What a runtime does for some frames.
#[derive(Clone, Copy, Debug)]
enum Spell {
    Off(i64),
    None(i64),
    Stall(i64),
    Period(i64),
}

fn spell() -> impl Strategy<Value = (usize, Spell)> {
    let either_way =
        |range| (range, any::<bool>()).prop_map(|(ns, ahead): (i64, bool)| if ahead { ns } else { -ns });
    let off = either_way(300_000_000..14_900_000_000i64).prop_map(Spell::Off);
    let none = prop_oneof![Just(0), Just(-1), Just(i64::MIN)].prop_map(Spell::None);
    let stall = (1..3_000i64).prop_map(Spell::Stall);
    let period = prop_oneof![Just(11_111_111), Just(16_666_667), Just(8_333_333)].prop_map(Spell::Period);
    (1usize..12, prop_oneof![3 => off, 1 => none, 1 => stall, 1 => period])
}

proptest! {
    /// Whatever is told for a while, display times are right again in the fifth frame after it, a single
    /// wrong one is right itself, and the frames dropped are those that were.
    #[test]
    fn whatever_is_told_is_healed(
        spells in proptest::collection::vec((spell(), 6usize..40), 1..6),
        lent in any::<bool>(),
    ) {
        let mut world = World::new(lent);
        world.steadily(6);
        let mut missed = 0;
        for ((frames, spell), rest) in spells {
            match spell {
                Spell::Off(by) => for frame in 0..frames {
                    let off = world.frame(|time| time + by);
                    prop_assert!(off == 0 || (frame >= 2 && off == by), "{frame}: {off}");
                },
                Spell::None(time) => (0..frames).for_each(|_| assert_eq!(world.frame(|_| time), 0)),
                Spell::Stall(periods) => {
                    world.start += periods * world.period;
                    missed += periods as u64;
                }
                Spell::Period(period) => world.period = period,
            }
            for frame in 0..rest {
                let off = world.frame(|time| time);
                prop_assert!(off == 0 || frame < 5, "{frame}: {off}");
            }
            let counted = world.clock.dropped;
            prop_assert!(counted <= missed, "{counted} dropped of {missed}");
        }
    }
}
