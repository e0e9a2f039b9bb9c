//! `report.html`: one file that opens anywhere, without network.

mod pictures;
mod tables;

use super::chart;
use super::report::{Point, Report};
use super::rivals::EVERY_PIXEL;
use super::sequence;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// A point's picture and error map as JPEG, by its name.
pub type Pictures<'a> = &'a dyn Fn(&str) -> Option<[Vec<u8>; 2]>;

/// The page.
pub fn html(report: &Report, pictures: Pictures<'_>, reference: Option<Vec<u8>>) -> String {
    let title = format!("What speed costs: {}", escaped(&report.scene));
    [
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n"
        ),
        about(report),
        front(report),
        pictures::closer(report),
        tables::sliders(report),
        tables::rivals(report),
        sequence::html(&report.sequences),
        pictures::side_by_side(report, pictures, reference),
        tables::all_points(report),
        notes(report),
        data(report),
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
    let (e, drift) = (&report.reference_error, report.drift());
    let rows = [
        ("scene", format!("{}, {} triangles", escaped(&report.scene), report.triangles)),
        ("devices", escaped(&report.device)),
        (
            "pictures",
            format!(
                "{}x{} (both eyes where there are two), {:.1} pixels per degree; {} poses, {} gazes each, {} frames each after {} that they may know of (what others do knows of none)",
                report.size[0],
                report.size[1],
                report.pixels_per_degree,
                report.places[0],
                report.places[1],
                report.places[2],
                report.history
            ),
        ),
        (
            "reference",
            format!(
                "{} passes, {} light rays a pixel; expected to be {:.1} dB from the truth ({:.1} dB as shown), relMSE {:.5}. A score that comes near says more about the reference than about the point.",
                e.passes, e.rays_per_pixel, e.psnr, e.psnr_display, e.relmse
            ),
        ),
        (
            "steadiness",
            format!(
                "between points frames of the given settings took {:.0} to {:.0} % of their median (10th to 90th percentile); that is taken out of all times",
                100.0 * drift[0],
                100.0 * drift[1]
            ),
        ),
    ];
    let origin = report.provenance.rows().into_iter().map(|(key, text)| (key, escaped(&text)));
    let rows = rows.into_iter().chain(origin);
    let rows: String = rows.map(|(key, text)| format!("<dt>{key}</dt><dd>{text}</dd>\n")).collect();
    format!("<dl>\n{rows}</dl>\n")
}

fn front(report: &Report) -> String {
    format!(
        "<section>\n<h2>Pareto front</h2>\n<p>{}</p>\n<p class=\"tools\">{}</p>\n<div class=\"chart\">{}<div id=\"tip\" hidden></div></div>\n<p class=\"legend\"><span class=\"given\">as given</span>\
         <span class=\"best\">on the Pareto front: nothing is at least as fast and as good; differences from the given settings within the spread do not count</span>\
         <span class=\"point\">other settings</span><span class=\"rival\">what others do</span> \
         Whiskers: 10th to 90th percentile of frame times; standard error of the score's distance from that of the given settings, over poses and gazes.</p>\n</section>\n",
        gist(report),
        chart::tools(),
        chart::svg(report)
    )
}

/// What the front says, in a sentence or two.
fn gist(report: &Report) -> String {
    let front = report.front();
    let (Some(fastest), Some(best)) = (front.first(), front.last()) else { return String::new() };
    let given = &report.points[0];
    let mut text = format!(
        "From <b>{:.1} ms at score {:.2}</b> (<i>{}</i>) to <b>{:.1} ms at score {:.2}</b> (<i>{}</i>).",
        fastest.frame_ms,
        fastest.foveated_score,
        escaped(&fastest.name),
        best.frame_ms,
        best.foveated_score,
        escaped(&best.name)
    );
    if let Some(full) = report.points.iter().find(|p| p.name == EVERY_PIXEL) {
        text += &format!(
            " A sample at every pixel takes {:.1} ms, {:.1} times the given settings, and scores {:.2} where they score {:.2}.",
            full.frame_ms,
            full.frame_ms / given.frame_ms.max(1e-9),
            full.foveated_score,
            given.foveated_score
        );
    }
    text
}

/// What the script knows of the points.
fn data(report: &Report) -> String {
    let point = |p: &Point| {
        serde_json::json!({
            "name": p.title(), "ms": p.frame_ms, "score": p.foveated_score, "psnr": p.psnr, "flip": p.flip,
            "flicker": p.flicker, "relmse": p.relmse, "samples": p.samples, "rays": p.rays, "front": p.on_front, "config": p.config,
        })
    };
    let points: Vec<serde_json::Value> = report.points.iter().map(point).collect();
    // Within a script nothing may look like a tag.
    let json = serde_json::Value::from(points).to_string().replace('<', "\\u003c");
    format!("<script type=\"application/json\" id=\"data\">{json}</script>\n")
}

fn notes(report: &Report) -> String {
    format!(
        "<section>\n<h2>How to read it</h2>\n<ul>\n\
         <li><b>frame time</b>: wall time of a whole frame, both eyes, pictures as four floats a pixel, while the head moves and the gaze rests, steadied by frames of the given settings before and after; a new gaze costs \"new gaze\" besides. It is coloured where the 10th to 90th percentiles of both do not overlap. \
         \"At equal cost\" is within 5 % of the given settings' time; what missed that says so.\n\
         <li><b>foveated score</b>: 10 / (1 + d/4) with d the foveated difference in thresholds of contrast: luminance bands of a Laplacian pyramid, \
         thresholds by frequency and eccentricity (Geisler and Perry 1998; Wang et al. 2001), masking (Daly 1993). \
         It depends on gaze, field of view and pixels per degree ({:.1} here). It is not a JOD: no observers were asked.\n\
         <li><b>PSNR</b>: in linear light up to display white. <b>relMSE</b>: in linear light of any brightness. <b>FLIP</b>: of what a screen shows (Andersson et al. 2020).\n\
         <li><b>temporal error</b> (flicker): how much the error changes between two frames of a moving head; <b>binocular error</b>: how much both eyes' errors differ \
         where they see the same; both the root of mean squares in sRGB codes of 0 to 1.\n\
         <li><b>late correction</b>: pictures traced where the head was a frame before they are shown, against what is seen from where \
         it is by then; all other points are judged where they were traced.\n\
         </ul>\n</section>\n",
        report.pixels_per_degree
    )
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::{point, report};
    use super::*;

    #[test]
    fn names_are_text_and_nothing_else() {
        let hostile = "</script><img src=x onerror=alert(1)>\"&";
        let given = point(hostile, "given", 10.0, 5.0, 10.0);
        let page =
            html(&report(hostile, vec![given, point("fast", "rays", 5.0, 4.0, 10.0)]), &|_| None, None);
        assert!(!page.contains("<img src=x"), "no tag from a name");
        assert_eq!(page.matches("</script>").count(), 2, "data and script end once each");
        assert!(page.contains("&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;&quot;&amp;"));
    }

    #[test]
    fn pictures_are_those_of_the_points_and_no_more_than_fit() {
        let points = vec![point("as given", "given", 10.0, 5.0, 10.0), point("fast", "rays", 5.0, 4.0, 10.0)];
        let small = |name: &str| Some([name.as_bytes().to_vec(), b"error".to_vec()]);
        let page = html(&report("scene", points.clone()), &small, Some(b"truth".to_vec()));
        assert_eq!(page.matches("data:image/jpeg").count(), 5);
        assert!(page.contains("data-point=\"1\"") && page.contains("All other points"));
        let huge = |_: &str| Some([vec![0; 10 << 20], Vec::new()]);
        let page = html(&report("scene", points), &huge, None);
        assert_eq!(page.matches("data:image/jpeg").count(), 2, "the given settings' alone");
    }
}
