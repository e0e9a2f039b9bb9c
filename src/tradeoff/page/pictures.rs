//! The page's pictures: one point beside the reference, chosen on the chart or along the front; and all of
//! them in rows.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::super::candidate::{GIVEN, RIVAL};
use super::super::report::{Point, Report};
use super::super::rivals::{AT_EQUAL_COST, EVERY_PIXEL};
use super::{Pictures, escaped};

/// Bytes of pictures in the page at most: what matters most comes first.
const MOST_BYTES: usize = 16 << 20;

/// A viewer that the script fills: a picture over the reference, its error map, its settings.
pub fn closer(report: &Report) -> String {
    let stops: Vec<String> = report.front().iter().map(|p| index_of(report, p).to_string()).collect();
    format!(
        "<section id=\"closer\" hidden>\n<h2>Look closer</h2>\n\
         <p>Walk along the front, or press a point of the chart. Left of the line is the point's picture, right of it \
         the reference; move the line. Beside it is the error map (FLIP, black is none); the ring marks the gaze.</p>\n\
         <label class=\"walk\"><span>fastest</span><input type=\"range\" id=\"walk\" min=\"0\" max=\"{}\" value=\"0\" \
         data-stops=\"{}\" aria-label=\"along the front\"><span>best</span></label>\n\
         <p id=\"facts\" aria-live=\"polite\"></p>\n\
         <div class=\"panes\"><div class=\"wipe\" role=\"slider\" tabindex=\"0\" aria-label=\"line between picture and reference\" aria-valuemin=\"0\" aria-valuemax=\"100\" aria-valuenow=\"50\"><img class=\"truth\" alt=\"the reference\"><img class=\"test\" alt=\"the point\">\
         <i></i></div><div class=\"error\"><img alt=\"its error\"></div></div>\n\
         <details><summary>Effective configuration</summary><pre id=\"config\"></pre></details>\n</section>\n",
        stops.len().saturating_sub(1),
        stops.join(",")
    )
}

/// Pictures with error maps, the given settings first, then the front, others' methods, and the rest.
pub fn side_by_side(report: &Report, pictures: Pictures<'_>, reference: Option<Vec<u8>>) -> String {
    let mut text = String::from(
        "<section>\n<h2>Side by side</h2>\n<p>The left eye's picture at the first pose; the ring marks the gaze. \
         Error maps show FLIP from black (none) over violet and orange to pale yellow. Press on a picture to see \
         the reference in its place.</p>\n<div class=\"pictures\">\n",
    );
    if let Some(reference) = reference {
        text += &format!(
            "<figure><div class=\"pair\">{}</div><figcaption><b>reference</b></figcaption></figure>\n",
            image(&reference, "the reference", " id=\"reference\"")
        );
    }
    let (mut bytes, mut folded) = (0, false);
    for (rank, point) in ranked(report) {
        let Some([picture, error]) = pictures(&point.name) else { continue };
        bytes += picture.len() + error.len();
        if bytes > MOST_BYTES {
            break;
        }
        if rank == Rank::Other && !folded {
            text += "</div>\n<details><summary>All other points</summary>\n<div class=\"pictures\">\n";
            folded = true;
        }
        text += &figure(index_of(report, point), point, &picture, &error);
    }
    text += if folded { "</div>\n</details>\n" } else { "</div>\n" };
    text + "</section>\n"
}

/// How much a point's pictures matter.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Rank {
    Given,
    Front,
    Rival,
    Other,
}

fn ranked(report: &Report) -> Vec<(Rank, &Point)> {
    let rank = |p: &Point| match p.axis.as_str() {
        GIVEN => Rank::Given,
        _ if p.on_front => Rank::Front,
        RIVAL if p.name.ends_with(AT_EQUAL_COST) || p.name == EVERY_PIXEL => Rank::Rival,
        _ => Rank::Other,
    };
    let mut list: Vec<(Rank, &Point)> = report.points.iter().map(|p| (rank(p), p)).collect();
    list.sort_by(|(a, p), (b, q)| a.cmp(b).then(p.frame_ms.total_cmp(&q.frame_ms)));
    list
}

fn index_of(report: &Report, point: &Point) -> usize {
    report.points.iter().position(|p| std::ptr::eq(p, point)).unwrap_or(0)
}

fn figure(index: usize, point: &Point, picture: &[u8], error: &[u8]) -> String {
    let name = escaped(&point.title());
    format!(
        "<figure data-point=\"{index}\"><div class=\"pair\"><span class=\"seen\">{}</span>{}</div>\
         <figcaption><b>{name}</b>: {:.1} ms, score {:.2}, {:.1} dB, FLIP {:.4}</figcaption></figure>\n",
        image(picture, &name, ""),
        image(error, &format!("error of {name}"), ""),
        point.frame_ms,
        point.foveated_score,
        point.psnr,
        point.flip
    )
}

fn image(jpeg: &[u8], alt: &str, more: &str) -> String {
    format!("<img{more} alt=\"{alt}\" src=\"data:image/jpeg;base64,{}\">", STANDARD.encode(jpeg))
}
