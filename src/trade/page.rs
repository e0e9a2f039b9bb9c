//! `report.html`: one file that opens anywhere, without network.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::candidate::{GIVEN, GRID, RIVAL};
use super::chart;
use super::report::{Point, Report};
use super::rivals::AT_EQUAL_COST;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// Pictures of this many points of the front at most.
const FRONT_PICTURES: usize = 8;

/// A point's picture and error map as JPEG, by its name.
pub type Pictures<'a> = &'a dyn Fn(&str) -> Option<[Vec<u8>; 2]>;

/// The page.
pub fn html(report: &Report, pictures: Pictures<'_>, reference: Option<Vec<u8>>) -> String {
    let title = format!("What speed costs: {}", escaped(&report.scene));
    [
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n"
        ),
        about(report),
        front(report),
        sliders(report),
        rivals(report),
        side_by_side(report, pictures, reference),
        all_points(report),
        notes(report),
        format!("</main>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n"),
    ]
    .concat()
}

/// Text that is safe between tags and in attributes.
pub fn escaped(text: &str) -> String {
    let safe = |c: char| match c {
        '&' => "&amp;".to_string(),
        '<' => "&lt;".to_string(),
        '>' => "&gt;".to_string(),
        '"' => "&quot;".to_string(),
        c if c.is_control() => " ".to_string(),
        c => c.to_string(),
    };
    text.chars().map(safe).collect()
}

fn about(report: &Report) -> String {
    let e = &report.reference_error;
    let rows = [
        ("scene", format!("{}, {} triangles", escaped(&report.scene), report.triangles)),
        ("devices", escaped(&report.device)),
        (
            "pictures",
            format!(
                "{}x{} (both eyes where there are two), {:.1} pixels per degree; {} poses, {} gazes each, {} frames each",
                report.size[0],
                report.size[1],
                report.pixels_per_degree,
                report.places[0],
                report.places[1],
                report.places[2]
            ),
        ),
        (
            "reference",
            format!(
                "{} passes, {} light rays a pixel; expected to be {:.1} dB from the truth ({:.1} dB as shown), relMSE {:.5}. A score that comes near says more about the reference than about the point.",
                e.passes, e.rays_per_pixel, e.psnr, e.psnr_display, e.relmse
            ),
        ),
    ];
    let rows: String = rows.iter().map(|(key, text)| format!("<dt>{key}</dt><dd>{text}</dd>\n")).collect();
    format!("<dl>\n{rows}</dl>\n")
}

fn front(report: &Report) -> String {
    format!(
        "<section>\n<h2>The front</h2>\n{}<p class=\"legend\"><span class=\"given\">as given</span>\
         <span class=\"best\">on the front: nothing is at least as fast and as good</span>\
         <span class=\"point\">other settings</span><span class=\"rival\">what others do</span> \
         Whiskers: 10th to 90th percentile of frame times; standard error of the score's distance from that of the given settings, over poses and gazes.</p>\n</section>\n",
        chart::svg(report)
    )
}

fn sliders(report: &Report) -> String {
    let given = &report.points[0];
    let mut axes: Vec<&str> = Vec::new();
    for point in &report.points {
        if ![GIVEN, GRID, RIVAL].contains(&point.axis.as_str()) && !axes.contains(&point.axis.as_str()) {
            axes.push(&point.axis);
        }
    }
    let mut text = format!(
        "<section>\n<h2>What each slider costs and gains</h2>\n<p>One slider moved, all others as given \
         ({:.1} ms, score {:.2}, {:.1} dB).</p>\n<table>\n<thead><tr><th>slider<th class=\"text\">value<th>ms<th>against given<th>score\
         <th>change<th>PSNR dB<th>change<th>flicker<th>eyes</tr></thead>\n",
        given.frame_ms, given.foveated_score, given.psnr
    );
    for axis in axes {
        let points: Vec<&Point> = report.points.iter().filter(|p| p.axis == axis).collect();
        for (index, p) in points.iter().enumerate() {
            let head = if index == 0 {
                format!("<th rowspan=\"{}\" scope=\"rowgroup\">{}</th>", points.len(), escaped(axis))
            } else {
                String::new()
            };
            let value = p.name.strip_prefix(axis).unwrap_or(&p.name).trim();
            text += &format!(
                "<tr>{head}<td>{}<td>{:.1}<td class=\"{}\">x{:.2}<td>{:.2}{}<td>{:.2}{}<td>{:.4}<td>{}</tr>\n",
                escaped(value),
                p.frame_ms,
                tone(given.frame_ms - p.frame_ms, 0.03 * given.frame_ms),
                p.frame_ms / given.frame_ms.max(1e-9),
                p.foveated_score,
                change(p.foveated_score - given.foveated_score, 0.02),
                p.psnr,
                change(p.psnr - given.psnr, 0.1),
                p.flicker,
                eyes(p),
            );
        }
    }
    text + "</table>\n<p>Points with other numbers of bounces are compared with references of as many bounces: \
            their scores tell of noise, not of the light that is left out.</p>\n</section>\n"
}

/// A cell that tells a change, coloured where it is more than a whim.
fn change(difference: f64, least: f64) -> String {
    format!("<td class=\"{}\">{difference:+.2}", tone(difference, least))
}

fn tone(difference: f64, least: f64) -> &'static str {
    match difference {
        d if d > least => "good",
        d if d < -least => "bad",
        _ => "same",
    }
}

fn eyes(p: &Point) -> String {
    p.disagreement.map_or(String::new(), |d| format!("{d:.4}"))
}

fn rivals(report: &Report) -> String {
    let given = &report.points[0];
    let mut text = String::from(
        "<section>\n<h2>What others do</h2>\n<p>Rendered with the same tracer, so that methods are compared. \
         \"At equal cost\" are those that were changed until a frame took as long as with the given settings.</p>\n\
         <table>\n<thead><tr><th>method<th>ms<th>score<th>change<th>PSNR dB<th>change<th>FLIP<th>flicker<th>eyes</tr></thead>\n",
    );
    let others = report.points.iter().filter(|p| p.axis == RIVAL);
    for p in std::iter::once(given).chain(others) {
        text += &format!(
            "<tr><td>{}<td>{:.1}<td>{:.2}{}<td>{:.2}{}<td>{:.4}<td>{:.4}<td>{}</tr>\n",
            escaped(&p.name),
            p.frame_ms,
            p.foveated_score,
            change(p.foveated_score - given.foveated_score, 0.02),
            p.psnr,
            change(p.psnr - given.psnr, 0.1),
            p.flip,
            p.flicker,
            eyes(p),
        );
    }
    text + "</table>\n</section>\n"
}

fn side_by_side(report: &Report, pictures: Pictures<'_>, reference: Option<Vec<u8>>) -> String {
    let mut text = String::from(
        "<section>\n<h2>Side by side</h2>\n<p>The left eye's picture at the first pose; the ring marks the gaze. \
         Error maps show FLIP from black (none) over violet and orange to pale yellow. Press on a picture to see \
         the reference in its place.</p>\n<div class=\"pictures\">\n",
    );
    if let Some(reference) = reference {
        text += &format!(
            "<figure><div>{}</div><figcaption>reference</figcaption></figure>\n",
            image(&reference, "the reference", " id=\"reference\"")
        );
    }
    let front = report.front();
    let step = front.len().div_ceil(FRONT_PICTURES).max(1);
    let shown = report
        .points
        .iter()
        .filter(|p| p.axis == GIVEN)
        .chain(front.into_iter().step_by(step).filter(|p| p.axis != GIVEN))
        .chain(
            report
                .points
                .iter()
                .filter(|p| p.axis == RIVAL && (p.name.ends_with(AT_EQUAL_COST) || p.name == "every pixel")),
        );
    for point in shown {
        let Some([picture, error]) = pictures(&point.name) else { continue };
        let name = escaped(&point.name);
        text += &format!(
            "<figure><div class=\"pair\"><span class=\"seen\">{}</span>{}</div>\
             <figcaption><b>{name}</b>: {:.1} ms, score {:.2}, {:.1} dB, FLIP {:.4}</figcaption></figure>\n",
            image(&picture, &name, ""),
            image(&error, &format!("error of {name}"), ""),
            point.frame_ms,
            point.foveated_score,
            point.psnr,
            point.flip
        );
    }
    text + "</div>\n</section>\n"
}

fn image(jpeg: &[u8], alt: &str, more: &str) -> String {
    format!("<img{more} alt=\"{alt}\" src=\"data:image/jpeg;base64,{}\">", STANDARD.encode(jpeg))
}

fn all_points(report: &Report) -> String {
    let mut text = String::from(
        "<section>\n<h2>All points</h2>\n<table id=\"points\">\n<thead><tr><th>name<th>ms<th>p10<th>p90<th>new gaze ms\
         <th>samples<th>rays<th>PSNR dB<th>relMSE<th>FLIP<th>score<th>flicker<th>eyes<th>front</tr></thead>\n<tbody>\n",
    );
    for (index, p) in report.points.iter().enumerate() {
        let config = serde_json::to_string_pretty(&p.config).unwrap_or_default();
        text += &format!(
            "<tr id=\"p{index}\"><td><details><summary>{}</summary><pre>{}</pre></details>\
             <td>{:.1}<td>{:.1}<td>{:.1}<td>{:.1}<td>{}<td>{}<td>{:.2}<td>{:.5}<td>{:.4}<td>{:.2}<td>{:.4}<td>{}<td>{}</tr>\n",
            escaped(&p.name),
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

fn notes(report: &Report) -> String {
    format!(
        "<section>\n<h2>How to read it</h2>\n<ul>\n\
         <li><b>ms</b>: wall time of a whole frame, both eyes, pictures as four floats a pixel, while the gaze rests; a new gaze costs \"new gaze ms\" besides.\n\
         <li><b>score</b>: 10 / (1 + d/4) with d the foveated difference in thresholds of contrast: luminance bands of a Laplacian pyramid, \
         thresholds by frequency and eccentricity (Geisler and Perry 1998; Wang et al. 2001), masking (Daly 1993). \
         It depends on gaze, field of view and pixels per degree ({:.1} here). It is not a JOD: no observers were asked.\n\
         <li><b>PSNR</b>: in linear light up to display white. <b>relMSE</b>: in linear light of any brightness. <b>FLIP</b>: of what a screen shows (Andersson et al. 2020).\n\
         <li><b>flicker</b>: how much the error changes between two frames of a moving head; <b>eyes</b>: how much both eyes' errors differ \
         where they see the same; both the root of mean squares in sRGB codes of 0 to 1.\n\
         </ul>\n</section>\n",
        report.pixels_per_degree
    )
}
