//! `foveate measure`, and its page in a browser.

use foveate::metrics::Picture;

use super::*;

// Without means over pictures, edges are the same whatever the rays are, and noise decides.
const MEASURE: &str = "measure scene.glb --quick --out trade --width 64 --height 32 --rays 4 --samples 0.2 \
                       --fov-y 12 --position 0.2,1.5,5 --look-at 0,0.9,0 --set time.pictures=1";

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
    let origin = &found["provenance"];
    for (key, part) in [
        ("version", env!("CARGO_PKG_VERSION")),
        ("date", "T"),
        ("command", "--quick"),
        ("system", std::env::consts::ARCH),
        ("processor", "threads"),
        ("key", ""),
    ] {
        let value = origin[key].as_str().unwrap_or_else(|| panic!("{key} of {origin}"));
        assert!(value.len() > 3 && value.contains(part), "{key} of {origin}");
    }
    assert_eq!(origin["drivers"].as_array().unwrap().len(), 2, "{origin}");
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
    for (name, path, expected) in [
        ("edge rays 0", "/trace/edge_rays", json!(0)),
        ("late correction on", "/headset/late_correction", json!(true)),
        ("late correction off", "/headset/late_correction", json!(false)),
    ] {
        assert_eq!(point(name)["config"].pointer(path), Some(&expected), "{name}");
    }
    // The other variant of the kernels makes the same picture, up to what rounding does.
    let traversal = points.iter().find(|p| p["axis"] == "traversal").expect("the kernels' variants");
    let apart = traversal["foveated_score"].as_f64().unwrap() - value("as given", "foveated_score");
    assert!(apart.abs() < 0.05, "{traversal}");
    // What was traced a frame ago is not what is seen now, and correcting that helps.
    let late = |name: &str| value(&format!("late correction {name}"), "foveated_score");
    assert!(late("on") > late("off") && late("off") < value("as given", "foveated_score"));
    assert!(value("rays 96", "psnr") > value("as given", "psnr"), "more rays, less noise");
    assert!(value("as given", "foveated_score") > value("reconstruction k-nn", "foveated_score"));
    // The front is what nothing beats, among the program's own settings.
    let front: Vec<&Value> = points.iter().filter(|p| p["on_front"] == true).collect();
    assert!(!front.is_empty() && front.len() < points.len());
    let number = |point: &Value, key: &str| point[key].as_f64().unwrap();
    for a in &front {
        for b in front.iter().filter(|b| b["name"] != a["name"]) {
            // Beyond the spread of both times.
            let faster = number(b, "frame_ms_p90") < number(a, "frame_ms_p10");
            assert!(!(faster && number(b, "foveated_score") >= number(a, "foveated_score")), "{b} beats {a}");
        }
    }
    sequences_are_told(&found, folder.path());
    let csv = std::fs::read_to_string(folder.path().join("trade/points.csv")).unwrap();
    assert_eq!(csv.lines().count(), points.len() + 1);
    let table = std::fs::read_to_string(folder.path().join("trade/comparison.md")).unwrap();
    // Provenance goes where figures go, and what claims to cost the same does, or says that it does not.
    for file in ["report.html", "front.toml"] {
        let text = std::fs::read_to_string(folder.path().join("trade").join(file)).unwrap();
        for key in ["version", "date", "processor", "key"] {
            assert!(text.contains(origin[key].as_str().unwrap()), "{key} in {file}");
        }
    }
    for point in points.iter().filter(|p| p["name"].as_str().unwrap().ends_with("at equal cost")) {
        let (cost, equal) = (point["cost"].as_f64().unwrap(), point["at_equal_cost"].as_bool().unwrap());
        assert_eq!(equal, (cost - 1.0).abs() <= 0.05, "{point}");
        assert_eq!(
            equal,
            !table.contains(&format!("{} (missed", point["name"].as_str().unwrap())),
            "{table}"
        );
        // Wherever the page names it: beside its mark in the chart, in what is told of it, in the list of all points.
        let page = std::fs::read_to_string(folder.path().join("trade/report.html")).unwrap();
        let missed = page.matches(&format!("{} (missed", point["name"].as_str().unwrap())).count();
        assert!(if equal { missed == 0 } else { missed >= 4 }, "{missed} times: {point}");
    }
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
    // Times are steadied by all points together; those of the machine are as they were found.
    let same = |a: &Value, b: &Value| a["pulse_ms"] == b["pulse_ms"];
    for (a, b) in points.iter().zip(again["points"].as_array().unwrap()) {
        assert_eq!(a["name"], b["name"]);
        assert!(same(a, b) || a["name"] == "rays 8", "{} was measured again", a["name"]);
    }
    // Other settings are another measurement.
    foveate(folder.path(), &format!("{MEASURE} --seed 5")).succeeds();
    assert_eq!(names(&parts).len(), 2);

    // Late pictures are no part of the chart: they are judged by another standard.
    let last = report(folder.path());
    let stops = last["points"].as_array().unwrap().iter().filter(|p| p["on_front"] == true).count();
    page_works(&folder.path().join("trade/report.html"), [points.len() - 2, points.len(), stops]);
}

/// Sequences: three ways along two motions, each with pictures for other programs to compare.
fn sequences_are_told(found: &Value, folder: &Path) {
    let sequences = found["sequences"].as_array().unwrap();
    let of = |motion: &str, name: &str| {
        let same = |s: &&Value| s["motion"] == motion && s["name"] == name;
        sequences.iter().find(same).unwrap_or_else(|| panic!("{motion}, {name}: {sequences:?}"))
    };
    assert_eq!(sequences.len(), 6);
    let value = |s: &Value, key: &str| s[key].as_f64().unwrap_or_else(|| panic!("{key} of {s}"));
    for motion in ["rest", "slow-turn"] {
        let [reused, single, every] =
            ["as given", "each frame for itself", "every pixel"].map(|name| of(motion, name));
        // What earlier frames know holds pictures still and makes them better; at rest by fewer rays.
        let rests = motion == "rest";
        let most = if rests { 0.7 } else { 0.95 };
        assert!(
            value(reused, "low_pass_flicker") < most * value(single, "low_pass_flicker"),
            "{reused} {single}"
        );
        assert!(value(reused, "psnr_display") > value(single, "psnr_display"), "{reused} {single}");
        assert!(!rests || value(reused, "rays") < value(single, "rays"), "{reused} {single}");
        assert!(value(every, "rays") > value(single, "rays"), "{every}");
        assert!(
            reused["disagreement"].is_number() && reused["lag"].is_null() && reused["uncovered"].is_null()
        );
    }
    let csv = std::fs::read_to_string(folder.join("trade/sequences.csv")).unwrap();
    assert_eq!(csv.lines().count(), 7);
    let page = std::fs::read_to_string(folder.join("trade/report.html")).unwrap();
    assert_eq!(page.matches("<table class=\"motion\">").count(), 2);
    let parts = folder.join("trade/parts");
    let parts = parts.join(&names(&parts)[0]);
    let frames: Vec<String> = names(&parts).into_iter().filter(|name| name.ends_with(".frames")).collect();
    // With the references'.
    assert_eq!(frames.len(), 8, "{frames:?}");
    for name in frames {
        let expected = if name == "sequence_reference_rest.frames" { 1 } else { 2 };
        assert_eq!(names(&parts.join(&name)).len(), expected, "{name}");
    }
}

/// Opens the page in a browser without network and looks at what has become of it.
fn page_works(page: &Path, [marks, rows, stops]: [usize; 3]) {
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
    assert_eq!([count("marks"), count("rows")], [marks, rows]);
    assert!(count("pictures") >= 11, "the reference, and two for each point shown");
    assert_eq!(count("pictures"), count("loaded"));
    assert_eq!(count("swapped"), 1, "pressing on a picture shows the reference");
    assert_eq!(count("sorted"), 1, "a click on a heading sorts");
    assert_eq!(count("opened"), 1, "a click on a point opens its row");
    assert_eq!(count("viewed"), 1, "and shows its picture over the reference");
    assert_eq!(count("told"), 1, "a point tells its settings when it is pointed at");
    assert_eq!(count("stops"), stops, "the front has a slider");
    assert_eq!(count("walked"), count("stops"), "which walks along it, from picture to picture");
    assert_eq!(count("wiped"), 1, "the line between picture and reference moves");
    assert_eq!(count("keyed"), 1, "points and the line are reached by keys");
    assert_eq!(count("moved"), 1, "other axes move the points, and the usual ones bring them back");
    assert_eq!(count("drawn"), 1, "the chart is saved with its provenance");
    assert_eq!(count("wide"), 0, "nothing reaches over a phone's edge");
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
        const viewer = (what) => document.querySelector("#closer " + what);
        const shown3 = document.querySelector('figure[data-point="3"] img').src;
        const viewed = viewer(".test").src === shown3 && viewer(".truth").naturalWidth > 0
          && viewer("#config").textContent.includes("foveation") && all(".mark.chosen").length === 1;
        all(".mark")[3].dispatchEvent(new Event("pointerenter"));
        const tip = document.getElementById("tip");
        const telling = !tip.hidden && tip.textContent.includes("rays") && tip.textContent.includes("ms, score");
        const walk = viewer("#walk"), names = new Set(), stops = walk.dataset.stops.split(",").length;
        for (let stop = 0; stop < stops; ++stop) {
          walk.value = stop;
          walk.dispatchEvent(new Event("input"));
          names.add(viewer("#facts b").textContent + viewer(".test").src.length);
        }
        const wipe = viewer(".wipe"), box = wipe.getBoundingClientRect();
        wipe.dispatchEvent(new PointerEvent("pointermove", { clientX: box.left + box.width / 4 }));
        const wiped = wipe.style.getPropertyValue("--at") === "25.0%";
        all(".mark")[3].focus();
        wipe.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
        const keyed = document.activeElement === all(".mark")[3] && wipe.style.getPropertyValue("--at") === "30%";
        const y = document.getElementById("axis-y"), given = all(".mark")[0];
        y.value = "flip";
        y.dispatchEvent(new Event("change"));
        const away = (given.getAttribute("transform") || "").includes("translate") && !given.getAttribute("transform").includes("NaN");
        y.value = "score";
        y.dispatchEvent(new Event("change"));
        const moved = away && !given.hasAttribute("transform");
        let saved = null;
        URL.createObjectURL = (blob) => { saved = blob; return ""; };
        HTMLAnchorElement.prototype.click = () => {};
        document.getElementById("save-svg").click();
        const drawn = saved !== null && saved.type === "image/svg+xml" && drawing().includes("processor: ");
        const told = { keyed: Number(keyed), moved: Number(moved), drawn: Number(drawn), viewed: Number(viewed), told: Number(telling), stops, walked: names.size,
          wiped: Number(wiped),
          wide: Number(document.documentElement.scrollWidth > document.documentElement.clientWidth), errors: window.errors, marks: all(".mark").length, rows: all("#points tbody tr").length,
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
            .arg("--window-size=500,900")
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

/// A quick measurement of one eye, whose parts are in `trade`.
const TINY: &str = "measure scene.glb --quick --out trade --width 24 --height 16 --rays 2 --stereo mono \
                    --position 0.2,1.5,5 --look-at 0,0.9,0";

#[test]
fn a_measurement_that_is_killed_goes_on_with_what_it_has() {
    let folder = folder();
    let parts = folder.path().join("trade/parts");
    let kept = || -> Vec<(PathBuf, Vec<u8>)> {
        let Ok(mut keys) = std::fs::read_dir(&parts) else { return Vec::new() };
        let Some(key) = keys.next() else { return Vec::new() };
        let files = std::fs::read_dir(key.unwrap().path()).unwrap().map(|file| file.unwrap().path());
        let whole = files.filter(|path| path.extension().is_some_and(|ending| ending == "json"));
        whole.filter_map(|path| Some((path.clone(), std::fs::read(path).ok()?))).collect()
    };
    let mut child = command(folder.path(), TINY).stderr(std::process::Stdio::null()).spawn().unwrap();
    // References and a few points.
    while kept().len() < 6 {
        assert_eq!(child.try_wait().unwrap(), None, "it ended before it could be killed");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = kept();
    assert!(!folder.path().join("trade/report.json").exists(), "killed in mid-run");
    foveate(folder.path(), TINY).succeeds();
    let found = report(folder.path());
    let names = |report: &Value| -> Vec<String> {
        let points = report["points"].as_array().unwrap();
        points.iter().map(|p| p["name"].as_str().unwrap().to_string()).collect()
    };
    for (path, bytes) in &before {
        assert!(std::fs::read(path).unwrap() == *bytes, "{} was made anew", path.display());
    }

    // Damaged parts are made anew, and the result has the same points as one that was left alone.
    for (path, bytes) in &before {
        std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    }
    let pictures = before.iter().map(|(path, _)| path.with_extension("exr")).filter(|path| path.exists());
    pictures.for_each(|path| std::fs::write(path, "no picture").unwrap());
    foveate(folder.path(), TINY).succeeds();
    let again = report(folder.path());
    assert_eq!(names(&again), names(&found));
    let scores = |report: &Value| -> Vec<Value> {
        report["points"].as_array().unwrap().iter().map(|p| p["foveated_score"].clone()).collect()
    };
    // What others do at equal cost depends on times.
    let own = names(&found).iter().position(|name| name == "every pixel").unwrap();
    assert_eq!(scores(&again)[..own], scores(&found)[..own], "the same seeds, the same pictures");
    assert_eq!(again["reference_error"], found["reference_error"]);
}

/// On a terminal there is a bar before anything else is waited for, and Ctrl-C says that nothing is lost.
#[cfg(target_os = "linux")]
#[test]
fn a_measurement_shows_a_bar_at_once_and_says_on_ctrl_c_that_it_goes_on() {
    let folder = folder();
    // `script` runs it on a terminal of its own, and hands on what is typed: Ctrl-C, once a part is kept.
    let typed = "until ls trade/parts/*/*.json >/dev/null 2>&1; do sleep 0.05; done; printf '\\003'; sleep 1";
    let line = format!("{{ {typed}; }} | TERM=xterm script -qec \"$F {TINY}\" /dev/null");
    let mut command = Command::new("sh");
    command.current_dir(folder.path()).env("F", env!("CARGO_BIN_EXE_foveate")).args(["-c", &line]);
    let told = run(command);
    assert_eq!(told.code, Some(130), "{told:?}");
    let bar = told.out.find("measuring [").unwrap_or_else(|| panic!("no bar: {told:?}"));
    let other = ["scene, ", "kernels and upload"].iter().filter_map(|step| told.out.find(step)).min();
    assert!(other.is_some_and(|other| bar < other), "{other:?}: {told:?}");
    let sentence = "stopped; trade keeps what was measured, and the same command goes on from there";
    assert!(told.out.contains(sentence), "{told:?}");
    assert!(!folder.path().join("trade/report.json").exists(), "stopped in mid-run");
}

#[test]
fn scenes_at_the_limits_are_measured_too() {
    let folder = folder();
    // A pixel for each eye.
    let one = "measure scene.glb --quick --out one --width 2 --height 1 --rays 2";
    let told = foveate(folder.path(), &format!("{one} --json")).succeeds().json();
    assert_eq!(told["size"], json!([2, 1]));
    // No light at all: every picture is right, and the front is its fastest point.
    let black = Picture::new(4, 2, vec![[0.0; 3]; 8]).unwrap();
    black.write_exr(&folder.path().join("black.exr")).unwrap();
    let dark = TINY.replace("--out trade", "--out dark --environment black.exr");
    let mut unlit = Builder::new();
    let floor = [[-9.0, 0.0, 9.0], [9.0, 0.0, 9.0], [0.0, 0.0, -9.0], [f32::NAN, 1.0, 0.0]];
    let (positions, indices) = (unlit.floats(&floor), unlit.shorts(&[0, 1, 2, 0, 1, 3]));
    unlit.place(json!({ "attributes": { "POSITION": positions }, "indices": indices }), json!({}));
    std::fs::create_dir(folder.path().join("unlit")).unwrap();
    unlit.write_glb(&folder.path().join("unlit"));
    let run = foveate(folder.path(), &dark.replace("scene.glb", "unlit/scene.glb"));
    assert_eq!(run.code, Some(0), "{run:?}");
    let told: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("dark/report.json")).unwrap()).unwrap();
    let points = told["points"].as_array().unwrap();
    for point in points {
        assert_eq!([&point["foveated_score"], &point["psnr"]], [&json!(10.0), &json!(200.0)], "{point}");
    }
    assert_eq!(points.iter().filter(|p| p["on_front"] == true).count(), 1);
}

#[test]
fn what_cannot_be_measured_is_told() {
    let folder = folder();
    let run = foveate(folder.path(), "measure none.glb --out trade --quick");
    assert!(run.sentence().contains("none.glb"), "{run:?}");
    let run = foveate(folder.path(), "measure scene.glb --out scene.glb --quick");
    assert!(run.sentence().contains("is a file, not a folder"), "{run:?}");
    let run = foveate(folder.path(), "measure scene.glb --out /proc/trade --quick");
    assert!(run.sentence().contains("/proc/trade"), "{run:?}");
    let run = foveate(folder.path(), "measure scene.glb --out trade --quick --headset rift9");
    assert!(run.sentence().contains("choose dk1 or generic"), "{run:?}");
    assert_eq!(names(folder.path()), ["scene.glb"]);
    let run = foveate(folder.path(), "measure scene.glb --out trade --quick --thorough");
    assert_eq!(run.code, Some(2), "{run:?}");
}

#[test]
fn sequences_are_measured_by_themselves_where_asked_and_time_passes_in_scenes_that_move() {
    let folder = folder();
    let day = "--set environment.day_length=4";
    foveate(folder.path(), &format!("{MEASURE} --in-motion {day}")).succeeds();
    let found = report(folder.path());
    assert_eq!(found["points"].as_array().unwrap().len(), 1);
    assert_eq!(found["points"][0]["name"], "as given");
    // A quick run has no moving scene among its motions, others have.
    assert_eq!(found["sequences"].as_array().unwrap().len(), 6);
    let usual = MEASURE.replace("--quick ", "").replace("--width 64 --height 32", "--width 32 --height 16");
    foveate(folder.path(), &format!("{usual} --in-motion {day}")).succeeds();
    let found = report(folder.path());
    let sequences = found["sequences"].as_array().unwrap();
    let of = |motion: &str| sequences.iter().filter(|s| s["motion"] == motion).collect::<Vec<_>>();
    for motion in ["rest", "slow-turn", "fast-turn", "walk", "scene"] {
        assert_eq!(of(motion).len(), 4, "{motion}: {sequences:?}");
    }
    let number = |s: &Value, key: &str| s[key].as_f64().unwrap_or_else(|| panic!("{key} of {s}"));
    // The sun goes on by a degree a frame. What is reused may be some frames late, and nothing else is.
    for s in of("scene") {
        let reused = !["each frame for itself", "every pixel"].contains(&s["name"].as_str().unwrap());
        assert_eq!(s["lag"].is_number(), reused, "{s}");
        assert!(!reused || (-1.0..4.0).contains(&number(s, "lag")), "{s}");
    }
    assert!(of("walk").iter().all(|s| s["uncovered"].is_array()), "{sequences:?}");
}
