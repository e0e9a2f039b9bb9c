//! What the budget controller climbs: operating points in their order.

use super::front::on_front;
use crate::config::{Config, OperatingPoint};

/// Points of one family, cheapest first, each dearer and better than the one before: they differ in
/// numbers of samples and rays alone, so that frames may move between them unseen.
#[derive(Clone, Debug, PartialEq)]
pub struct QualityLevels {
    steps: Vec<OperatingPoint>,
    /// It is not of the family of the settings that it was chosen for.
    pub foreign: bool,
}

impl QualityLevels {
    /// The best levels among points: of the family that `config` belongs to where that has at least two
    /// steps, else of the family with the most steps. `None` without points.
    pub fn of(points: &[OperatingPoint], config: &Config) -> Option<QualityLevels> {
        let given = OperatingPoint::of(config, 1, 1.0, 0.0);
        let own = QualityLevels::family(points, &given);
        if own.len() >= 2 {
            return Some(QualityLevels { steps: own, foreign: false });
        }
        let families = points.iter().map(|point| QualityLevels::family(points, point));
        let steps = families.max_by_key(Vec::len)?;
        let foreign = !steps.first()?.same_family(&given);
        Some(QualityLevels { steps, foreign })
    }

    /// The front among points that differ from `member` in samples and rays only.
    fn family(points: &[OperatingPoint], member: &OperatingPoint) -> Vec<OperatingPoint> {
        let family: Vec<OperatingPoint> = points.iter().filter(|p| p.same_family(member)).copied().collect();
        let values: Vec<(f64, f64)> = family.iter().map(|p| (p.frame_ms, p.score)).collect();
        let mut steps: Vec<OperatingPoint> =
            family.into_iter().zip(on_front(&values)).filter(|(_, best)| *best).map(|(p, _)| p).collect();
        steps.sort_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
        steps
    }

    /// The steps, cheapest first; at least one.
    pub fn steps(&self) -> &[OperatingPoint] {
        &self.steps
    }

    /// The last step.
    pub fn top(&self) -> f64 {
        (self.steps.len() - 1) as f64
    }

    /// A value between the steps around a position.
    pub fn between(&self, position: f64, value: impl Fn(&OperatingPoint) -> f64) -> f64 {
        let position = position.clamp(0.0, self.top());
        let low = position.floor();
        let (a, b) = (&self.steps[low as usize], &self.steps[(low as usize + 1).min(self.steps.len() - 1)]);
        let (a, b) = (value(a), value(b));
        a + (b - a) * (position - low)
    }

    /// The same between the logarithms of values above 0.
    pub fn between_logs(&self, position: f64, value: impl Fn(&OperatingPoint) -> f64) -> f64 {
        self.between(position, |p| value(p).ln()).exp()
    }

    /// The highest position up to which a value that grows along the levels is at most `limit`; 0 where
    /// none is.
    pub fn reach(&self, limit: f64, value: impl Fn(&OperatingPoint) -> f64) -> f64 {
        let above = self.steps.iter().position(|p| value(p) > limit);
        let Some(above) = above else { return self.top() };
        if above == 0 {
            return 0.0;
        }
        let (low, high) = (value(&self.steps[above - 1]), value(&self.steps[above]));
        (above - 1) as f64 + (limit - low) / (high - low)
    }
}
