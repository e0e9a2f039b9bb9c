//! The page's tables: sliders, what others do, all points.

use std::cmp::Ordering;

use super::super::candidate::{GIVEN, GRID, LATE, RIVAL};
use super::super::report::{LeftOut, Point, Report};
use super::super::spread;
use super::escaped;

/// One slider moved, all others as given: what each value costs and gains.
pub fn sliders(report: &Report) -> String {
    let given = &report.points[0];
    let mut axes: Vec<&str> = Vec::new();
    for point in &report.points {
        if ![GIVEN, GRID, RIVAL].contains(&point.axis.as_str()) && !axes.contains(&point.axis.as_str()) {
            axes.push(&point.axis);
        }
    }
    let moved: Vec<&Point> = report.points.iter().filter(|p| axes.contains(&p.axis.as_str())).collect();
    let scale = |value: &dyn Fn(&Point) -> f64| {
        let usual = moved.iter().filter(|p| p.axis != LATE).map(|p| value(p).abs());
        usual.fold(1e-9, f64::max)
    };
    let (octaves, gain) =
        (|p: &Point| octaves(given, p), |p: &Point| p.foveated_score - given.foveated_score);
    let scales = [scale(&octaves), scale(&gain)];
    let mut text = format!(
        "<section>\n<h2>What each parameter costs and gains</h2>\n<p>One parameter changed, all others as given \
         ({:.1} ms, score {:.2}, {:.1} dB). Bars to the left are less, to the right more; green is better, beyond the \
         measured spread.</p>\n\
         <table class=\"sliders\">\n<thead><tr><th>parameter<th class=\"text\">value<th>frame time (ms)<th colspan=\"2\">relative<th>foveated score\
         <th colspan=\"2\">change<th>PSNR (dB)<th>change<th>temporal error<th>binocular error</tr></thead>\n",
        given.frame_ms, given.foveated_score, given.psnr
    );
    for axis in axes {
        let points: Vec<&&Point> = moved.iter().filter(|p| p.axis == axis).collect();
        for (index, p) in points.iter().enumerate() {
            let head = if index == 0 {
                format!("<th rowspan=\"{}\" scope=\"rowgroup\">{}</th>", points.len(), escaped(axis))
            } else {
                String::new()
            };
            let value = p.name.strip_prefix(axis).unwrap_or(&p.name).trim();
            text += &format!(
                "<tr>{head}<td>{}<td>{:.1}<td class=\"{}\">x{:.2}{}<td>{:.2}{}{}<td>{:.2}{}<td>{:.4}<td>{}</tr>\n",
                escaped(value),
                p.frame_ms,
                tone(spread::time(given, p).reverse()),
                p.frame_ms / given.frame_ms.max(1e-9),
                bar(octaves(p) / scales[0], tone(spread::time(given, p).reverse())),
                p.foveated_score,
                score_change(given, p),
                bar(gain(p) / scales[1], tone(spread::score(given, p, LEAST_SCORE))),
                p.psnr,
                change(p.psnr - given.psnr, 0.1),
                p.flicker,
                eyes(p),
            );
        }
    }
    text + "</table>\n<p>"
        + &light_left_out(report)
        + "Points with other numbers of bounces are compared with references of as many bounces: their scores tell \
            of noise. Late pictures are compared with what is \
            seen from where the head is when they are shown.</p>\n</section>\n"
}

/// What the missing light would add, where it was measured.
fn light_left_out(report: &Report) -> String {
    let of = |l: &LeftOut| {
        format!(
            "Without noise, {} of {} bounces score {:.2} ({:.1} dB, FLIP {:.4}): so much is the light worth that is \
             left out. ",
            l.bounces, l.of, l.foveated_score, l.psnr, l.flip
        )
    };
    report.light_left_out.iter().map(of).collect()
}

/// How many times a point's frame time is twice that of the given settings.
fn octaves(given: &Point, p: &Point) -> f64 {
    let ratio = p.frame_ms / given.frame_ms;
    if ratio > 0.0 && ratio.is_finite() { ratio.log2() } else { 0.0 }
}

/// Scores that are nearer than this look the same.
const LEAST_SCORE: f64 = 0.02;

/// A cell with a bar from its middle; `value` is in -1..1.
fn bar(value: f64, tone: &str) -> String {
    let percent = 50.0 * value.clamp(-1.0, 1.0);
    format!(
        "<td class=\"bar\"><i class=\"{}\" style=\"left:{:.1}%;width:{:.1}%\"></i>",
        tone,
        50.0 + percent.min(0.0),
        percent.abs()
    )
}

/// A cell that tells a change, coloured where it is more than a whim.
fn change(difference: f64, least: f64) -> String {
    let beyond = if difference.abs() > least { difference.total_cmp(&0.0) } else { Ordering::Equal };
    format!("<td class=\"{}\">{difference:+.2}", tone(beyond))
}

/// A cell that tells how a point's score differs, coloured where that is more than the spread.
fn score_change(given: &Point, p: &Point) -> String {
    let apart = p.foveated_score - given.foveated_score;
    format!("<td class=\"{}\">{apart:+.2}", tone(spread::score(given, p, LEAST_SCORE)))
}

/// The colour of what is more (good), less (bad), or cannot be told.
fn tone(more: Ordering) -> &'static str {
    match more {
        Ordering::Greater => "good",
        Ordering::Less => "bad",
        Ordering::Equal => "same",
    }
}

fn eyes(p: &Point) -> String {
    p.disagreement.map_or(String::new(), |d| format!("{d:.4}"))
}

/// Others' methods beside the given settings.
pub fn rivals(report: &Report) -> String {
    let given = &report.points[0];
    let mut text = String::from(
        "<section>\n<h2>What others do</h2>\n<p>Rendered with the same tracer, so that methods are compared. \
         \"At equal cost\" are those that were changed until a frame took as long as with the given settings, within 5 %; \
         what missed that says by how much.</p>\n\
         <table>\n<thead><tr><th>method<th>frame time (ms)<th>relative<th>foveated score<th>change<th>PSNR (dB)<th>change<th>FLIP\
         <th>temporal error<th>binocular error</tr></thead>\n",
    );
    let others = report.points.iter().filter(|p| p.axis == RIVAL);
    for p in std::iter::once(given).chain(others) {
        text += &format!(
            "<tr><td>{}<td>{:.1}<td class=\"{}\">x{:.2}<td>{:.2}{}<td>{:.2}{}<td>{:.4}<td>{:.4}<td>{}</tr>\n",
            escaped(&p.title()),
            p.frame_ms,
            if p.at_equal_cost == Some(false) { "bad" } else { tone(spread::time(given, p).reverse()) },
            p.cost,
            p.foveated_score,
            score_change(given, p),
            p.psnr,
            change(p.psnr - given.psnr, 0.1),
            p.flip,
            p.flicker,
            eyes(p),
        );
    }
    text + "</table>\n</section>\n"
}

/// Every point with its effective configuration.
pub fn all_points(report: &Report) -> String {
    let mut text = String::from(
        "<section>\n<h2>All points</h2>\n<table id=\"points\">\n<thead><tr><th>name<th>frame time (ms)<th>10th percentile<th>90th percentile<th>new gaze (ms)\
         <th>samples<th>rays<th>PSNR (dB)<th>relMSE<th>FLIP<th>foveated score<th>temporal error<th>binocular error<th>Pareto front</tr></thead>\n<tbody>\n",
    );
    for (index, p) in report.points.iter().enumerate() {
        let config = serde_json::to_string_pretty(&p.config).unwrap_or_default();
        text += &format!(
            "<tr id=\"p{index}\"><td><details><summary>{}</summary><pre>{}</pre></details>\
             <td>{:.1}<td>{:.1}<td>{:.1}<td>{:.1}<td>{}<td>{}<td>{:.2}<td>{:.5}<td>{:.4}<td>{:.2}<td>{:.4}<td>{}<td>{}</tr>\n",
            escaped(&p.title()),
            escaped(&config).replace("  ", "&#160;&#160;"),
            p.frame_ms,
            p.frame_ms_p10,
            p.frame_ms_p90,
            p.pattern_ms,
            p.samples,
            p.rays,
            p.psnr,
            p.relmse,
            p.flip,
            p.foveated_score,
            p.flicker,
            eyes(p),
            if p.on_front { "yes" } else { "" },
        );
    }
    text + "</tbody>\n</table>\n</section>\n"
}
