//! `foveate measure`, and its page in a browser.

use super::*;

const MEASURE: &str = "measure scene.glb --quick --out trade --width 64 --height 32 --rays 4 --samples 0.2 \
                       --position 0.2,1.5,5 --look-at 0,0.9,0";

/// The report that a run left.
fn report(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("trade/report.json")).unwrap()).unwrap()
}

#[test]
fn a_measurement_reports_its_points_and_goes_on_where_it_was() {
    let folder = folder();
    let told = foveate(folder.path(), &format!("{MEASURE} --json")).succeeds().json();
    let found = report(folder.path());
    assert_eq!(told, found);
    assert_eq!([&found["scene"], &found["size"]], [&json!("scene.glb"), &json!([64, 32])]);
    assert!(found["reference_error"]["psnr"].as_f64().unwrap() > 20.0);
    assert!(found["device"].as_str().unwrap().contains("Vulkan"));
    let points = found["points"].as_array().unwrap();
    assert!(points.len() > 15, "{}", points.len());
    for point in points {
        for key in ["frame_ms", "psnr", "flip", "foveated_score", "flicker", "disagreement"] {
            let value = point[key].as_f64().unwrap_or_else(|| panic!("{key} of {point}"));
            assert!(value >= 0.0, "{key} of {point}");
        }
        assert!(point["config"].is_object() && point["on_front"].is_boolean(), "{point}");
        assert!(point["foveated_score"].as_f64().unwrap() <= 10.0);
    }
    let point = |name: &str| points.iter().find(|p| p["name"] == name).expect(name);
    let value = |name: &str, key: &str| point(name)[key].as_f64().unwrap();
    assert_eq!(point("rays 8")["config"]["trace"]["rays"], 8);
    assert!(value("rays 96", "psnr") > value("as given", "psnr"), "more rays, less noise");
    assert!(value("as given", "foveated_score") > value("reconstruction k-nn", "foveated_score"));
    // The front is what nothing beats, among the program's own settings.
    let front: Vec<&Value> = points.iter().filter(|p| p["on_front"] == true).collect();
    assert!(!front.is_empty() && front.len() < points.len());
    let better = |a: &Value, b: &Value, key: &str| a[key].as_f64() >= b[key].as_f64();
    for a in &front {
        for b in front.iter().filter(|b| b["name"] != a["name"]) {
            assert!(!(better(a, b, "frame_ms") && better(b, a, "foveated_score")), "{b} beats {a}");
        }
    }
    let csv = std::fs::read_to_string(folder.path().join("trade/points.csv")).unwrap();
    assert_eq!(csv.lines().count(), points.len() + 1);
    let table = std::fs::read_to_string(folder.path().join("trade/comparison.md")).unwrap();
    for rival in ["the paper's settings", "zones of 32/16/8", "foveated inset", "lower resolution"] {
        assert!(table.contains(rival), "{table}");
    }
    // The front is a file of settings.
    let front = folder.path().join("trade/front.toml");
    let run = "render scene.glb --width 48 --height 32 --out a.png --config trade/front.toml";
    foveate(folder.path(), run).succeeds();
    assert!(std::fs::read_to_string(front).unwrap().contains("[[budget.front]]"));

    // The same again takes what is there; a part that is missing is made anew, and nothing else.
    let parts = folder.path().join("trade/parts");
    let key = parts.join(&names(&parts)[0]);
    let lost = key.join("rays_8.json");
    std::fs::remove_file(&lost).unwrap();
    foveate(folder.path(), MEASURE).succeeds();
    assert!(lost.exists());
    let again = report(folder.path());
    let same = |a: &Value, b: &Value| a["frame_ms"] == b["frame_ms"];
    for (a, b) in points.iter().zip(again["points"].as_array().unwrap()) {
        assert_eq!(a["name"], b["name"]);
        assert!(same(a, b) || a["name"] == "rays 8", "{} was measured again", a["name"]);
    }
    // Other settings are another measurement.
    foveate(folder.path(), &format!("{MEASURE} --seed 5")).succeeds();
    assert_eq!(names(&parts).len(), 2);

    page_works(&folder.path().join("trade/report.html"), points.len());
}

/// Opens the page in a browser without network and looks at what has become of it.
fn page_works(page: &Path, points: usize) {
    let text = std::fs::read_to_string(page).unwrap();
    for reference in ["src=\"http", "href=\"http", "url(", "@import", "fetch("] {
        assert!(!text.contains(reference), "the page asks for something outside: {reference}");
    }
    let Some(dom) = browsed(page) else { return };
    let count = |what: &str| -> usize {
        let (_, rest) = dom.split_once(&format!("{what}=")).unwrap_or_else(|| panic!("{what} of {dom:.400}"));
        rest.split(';').next().unwrap().parse().unwrap()
    };
    assert_eq!(count("errors"), 0);
    assert_eq!([count("marks"), count("rows")], [points; 2]);
    assert!(count("pictures") >= 11, "the reference, and two for each point shown");
    assert_eq!(count("pictures"), count("loaded"));
    assert_eq!(count("swapped"), 1, "pressing on a picture shows the reference");
    assert_eq!(count("sorted"), 1, "a click on a heading sorts");
    assert_eq!(count("opened"), 1, "a click on a point opens its row");
}

/// What the probe below told in a browser; none where there is no browser.
fn browsed(page: &Path) -> Option<String> {
    const PROBE: &str = r##"<script>
      addEventListener("load", () => {
        const all = (what) => [...document.querySelectorAll(what)];
        const images = all("img");
        const seen = all(".seen")[0], shown = seen.querySelector("img"), own = shown.src;
        seen.dispatchEvent(new Event("pointerdown"));
        const swapped = shown.src !== own && shown.src === document.getElementById("reference").src;
        seen.dispatchEvent(new Event("pointerup"));
        all("#points thead th")[1].click();
        const times = all("#points tbody tr").map((row) => Number(row.cells[1].textContent));
        const sorted = times.every((t, i) => i === 0 || times[i - 1] <= t);
        all(".mark")[3].dispatchEvent(new Event("click"));
        const told = { errors: window.errors, marks: all(".mark").length, rows: all("#points tbody tr").length,
          pictures: images.length, loaded: images.filter((i) => i.naturalWidth > 0).length,
          swapped: Number(swapped && shown.src === own), sorted: Number(sorted),
          opened: Number(document.querySelector("#p3 details").open) };
        document.title = "probe " + Object.entries(told).map(([k, v]) => k + "=" + v + ";").join(" ");
      });</script>"##;
    let folder = tempfile::tempdir().unwrap();
    let probed = folder.path().join("page.html");
    let catcher = "<script>window.errors = 0; addEventListener(\"error\", () => ++window.errors);</script>";
    let text = std::fs::read_to_string(page).unwrap();
    std::fs::write(&probed, text.replacen("<head>", &format!("<head>{catcher}"), 1) + PROBE).unwrap();
    let output = ["chromium", "chromium-browser", "google-chrome"].iter().find_map(|browser| {
        Command::new(browser)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
            .args(["--disable-background-networking", "--virtual-time-budget=5000", "--dump-dom"])
            .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
            .arg(format!("file://{}", probed.display()))
            .output()
            .ok()
    });
    let Some(output) = output else {
        let ubuntu = std::fs::read_to_string("/etc/os-release").unwrap_or_default().contains("ID=ubuntu");
        assert!(ubuntu || std::env::var("CI").as_deref() != Ok("true"), "no browser");
        println!("not run: the page in a browser (no chromium)");
        return None;
    };
    assert!(output.status.success(), "{output:?}");
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn what_cannot_be_measured_is_told() {
    let folder = folder();
    let run = foveate(folder.path(), "measure none.glb --out trade --quick");
    assert!(run.sentence().contains("none.glb"), "{run:?}");
    let run = foveate(folder.path(), "measure scene.glb --out scene.glb --quick");
    assert!(run.sentence().contains("is a file, not a folder"), "{run:?}");
    let run = foveate(folder.path(), "measure scene.glb --out trade --quick --headset rift9");
    assert!(run.sentence().contains("choose dk1 or generic"), "{run:?}");
    assert_eq!(names(folder.path()), ["scene.glb"]);
    let run = foveate(folder.path(), "measure scene.glb --out trade --quick --thorough");
    assert_eq!(run.code, Some(2), "{run:?}");
}
