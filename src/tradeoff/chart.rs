//! The chart of the page: frame time against score, as SVG.

use super::candidate::{GIVEN, LATE, RIVAL};
use super::report::{Point, Report};

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 440.0;
/// Room for labels: left, right, top, bottom.
const MARGIN: [f64; 4] = [56.0, 16.0, 16.0, 48.0];

/// A scale from values to pixels of the chart.
struct Scale {
    x: [f64; 2],
    y: [f64; 2],
}

impl Scale {
    fn of(points: &[&Point]) -> Scale {
        let range = |values: &mut dyn Iterator<Item = f64>| {
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
        };
        let x = range(&mut points.iter().map(|p| p.frame_ms.max(1e-3).ln()));
        let y = range(&mut points.iter().map(|p| p.foveated_score));
        let padded = |[low, high]: [f64; 2], least: f64| {
            let pad = ((high - low) * 0.06).max(least);
            [low - pad, high + pad]
        };
        Scale { x: padded(x, 0.05), y: padded(y, 0.05) }
    }

    fn x(&self, ms: f64) -> f64 {
        let t = (ms.max(1e-3).ln() - self.x[0]) / (self.x[1] - self.x[0]);
        MARGIN[0] + t * (WIDTH - MARGIN[0] - MARGIN[1])
    }

    fn y(&self, score: f64) -> f64 {
        let t = (score - self.y[0]) / (self.y[1] - self.y[0]);
        HEIGHT - MARGIN[3] - t * (HEIGHT - MARGIN[2] - MARGIN[3])
    }
}

/// What the chart can show instead, and its files: the script fills them with life.
pub fn tools() -> String {
    let choice = |axis: &str, options: &[(&str, &str)]| {
        let options: String =
            options.iter().map(|(key, name)| format!("<option value=\"{key}\">{name}</option>")).collect();
        format!("<label>{axis} <select id=\"axis-{axis}\">{options}</select></label> ")
    };
    let x = [("ms", "frame time (ms)"), ("samples", "samples"), ("rays", "rays")];
    let y = [
        ("score", "foveated score"),
        ("psnr", "PSNR (dB)"),
        ("flip", "FLIP"),
        ("relmse", "relMSE"),
        ("flicker", "temporal error"),
    ];
    choice("x", &x)
        + &choice("y", &y)
        + "<button type=\"button\" id=\"save-svg\">SVG</button> <button type=\"button\" id=\"save-png\">PNG</button>"
}

/// All points that are judged where they were traced, with a line through the front.
pub fn svg(report: &Report) -> String {
    let shown = || report.points.iter().enumerate().filter(|(_, p)| p.axis != LATE);
    let scale = Scale::of(&shown().map(|(_, p)| p).collect::<Vec<_>>());
    let mut svg = format!(
        "<svg id=\"chart\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"Frame time against foveated score\">\n"
    );
    svg += &axes(&scale);
    let line: Vec<String> = report
        .front()
        .iter()
        .map(|p| format!("{:.1},{:.1}", scale.x(p.frame_ms), scale.y(p.foveated_score)))
        .collect();
    svg += &format!("<polyline class=\"front\" points=\"{}\"/>\n", line.join(" "));
    let mut labels = Labels::default();
    for (index, point) in shown() {
        svg += &mark(&scale, index, point, &mut labels);
    }
    svg + "</svg>\n"
}

/// Where labels are, so that none lies on another.
#[derive(Default)]
struct Labels(Vec<[f64; 4]>);

impl Labels {
    /// The baseline for a label at a mark: as near to it as others allow.
    fn place(&mut self, x: f64, y: f64, letters: usize, end: bool) -> f64 {
        let width = letters as f64 * 6.4;
        let left = if end { x - width } else { x };
        let boxed = |y: f64| [left, y - 10.0, left + width, y + 3.0];
        let free = |y: &f64| {
            let b = boxed(*y);
            self.0.iter().all(|o| b[2] < o[0] || o[2] < b[0] || b[3] < o[1] || o[3] < b[1])
        };
        let tries = [4.0, 18.0, -10.0, 32.0, -24.0, 46.0, -38.0, 60.0].map(|dy| y + dy);
        let inside = |y: &f64| (MARGIN[2] + 10.0..HEIGHT - MARGIN[3]).contains(y);
        let chosen = tries.into_iter().find(|y| inside(y) && free(y)).unwrap_or(tries[0]);
        self.0.push(boxed(chosen));
        chosen
    }
}

/// A point: where it is, how sure that is, and what it is when it is pointed at.
fn mark(scale: &Scale, index: usize, p: &Point, labels: &mut Labels) -> String {
    let (x, y) = (scale.x(p.frame_ms), scale.y(p.foveated_score));
    let class = match p.axis.as_str() {
        GIVEN => "given",
        RIVAL => "rival",
        _ if p.on_front => "best",
        _ => "point",
    };
    let whiskers = format!(
        "<path class=\"whisker\" d=\"M{:.1} {y:.1}H{:.1}M{x:.1} {:.1}V{:.1}\"/>",
        scale.x(p.frame_ms_p10),
        scale.x(p.frame_ms_p90),
        scale.y(p.foveated_score - p.foveated_score_error),
        scale.y(p.foveated_score + p.foveated_score_error),
    );
    let shape = match class {
        "rival" => format!(
            "<path class=\"shape\" d=\"M{x:.1} {:.1}l6 6l-6 6l-6 -6z\" transform=\"translate(0 -6)\"/>",
            y
        ),
        "given" => format!("<circle class=\"shape\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\"/>"),
        _ => format!("<circle class=\"shape\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\"/>"),
    };
    let label = match class {
        "given" | "rival" => {
            let end = x > WIDTH * 0.7;
            let (dx, anchor) = if end { (-10.0, "end") } else { (10.0, "start") };
            let baseline = labels.place(x + dx, y, p.title().chars().count(), end);
            format!(
                "<text x=\"{:.1}\" y=\"{baseline:.1}\" text-anchor=\"{anchor}\">{}</text>",
                x + dx,
                super::page::escaped(&p.title())
            )
        }
        _ => String::new(),
    };
    format!(
        "<a href=\"#p{index}\" class=\"mark {class}\" data-point=\"{index}\"><title>{}: {:.1} ms, foveated score {:.2}</title>{whiskers}{shape}{label}</a>\n",
        super::page::escaped(&p.title()),
        p.frame_ms,
        p.foveated_score
    )
}

fn axes(scale: &Scale) -> String {
    let (left, bottom) = (MARGIN[0], HEIGHT - MARGIN[3]);
    let (right, top) = (WIDTH - MARGIN[1], MARGIN[2]);
    let mut svg = String::from("<g class=\"axes\">\n");
    for ms in decades(scale.x[0].exp(), scale.x[1].exp()) {
        let x = scale.x(ms);
        svg += &format!(
            "<path d=\"M{x:.1} {bottom}V{top}\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{ms}</text>\n",
            bottom + 18.0
        );
    }
    let step = score_step(scale.y[1] - scale.y[0]);
    let mut score = (scale.y[0] / step).ceil() * step;
    while score <= scale.y[1] {
        let y = scale.y(score);
        svg += &format!(
            "<path d=\"M{left} {y:.1}H{right}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\n",
            left - 8.0,
            y + 4.0,
            (score * 100.0).round() / 100.0
        );
        score += step;
    }
    svg += &format!(
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">milliseconds of a frame (logarithmic)</text>\n",
        (left + right) / 2.0,
        HEIGHT - 8.0
    );
    svg += &format!(
        "<text transform=\"translate(16 {:.1}) rotate(-90)\" text-anchor=\"middle\">foveated score</text>\n</g>\n",
        (top + bottom) / 2.0
    );
    svg
}

/// 1, 2 and 5 times powers of ten within a range.
fn decades(low: f64, high: f64) -> Vec<f64> {
    let first = low.log10().floor() as i32;
    let last = high.log10().ceil() as i32;
    let values = (first..=last).flat_map(|p| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(p)));
    values.filter(|v| (low..=high).contains(v)).map(|v| (v * 1e6).round() / 1e6).collect()
}

/// A step that gives some six lines.
fn score_step(range: f64) -> f64 {
    [0.05, 0.1, 0.2, 0.5, 1.0].into_iter().find(|step| range / step <= 8.0).unwrap_or(2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_do_not_lie_on_each_other() {
        let mut labels = Labels::default();
        let places: Vec<f64> = (0..4).map(|_| labels.place(100.0, 200.0, 20, false)).collect();
        assert_eq!(places, [204.0, 218.0, 190.0, 232.0]);
        assert_eq!(labels.place(400.0, 200.0, 20, false), 204.0);
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(decades(3.0, 60.0), [5.0, 10.0, 20.0, 50.0]);
        assert_eq!(decades(0.15, 0.6), [0.2, 0.5]);
        assert_eq!(score_step(3.0), 0.5);
    }
}
