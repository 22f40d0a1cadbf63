//! The page over all scenes: a table of the best settings at three frame times, then for each scene
//! a sentence of advice and the plot, and what the figures mean.

use super::scenes::Scene;
use anyhow::{Context, Result};
use serde_json::{Map, Value};

/// Most characters of a line.
const COLUMNS: usize = 100;
/// Time of the advice beside each plot, milliseconds.
const ADVISED_MS: f64 = 33.0;

/// What the page begins with.
const HEAD: &str = "\
# Error against run time

Which method and settings to draw a scan with: eight scenes of different kinds, each drawn by every
method and with every setting that trades quality for time. Each picture is compared with what it
should be. The pages behind the names have all settings, crops of pictures beside their errors, and
the error while a file is loaded.
";

/// What the figures mean, and how they are renewed.
const TAIL: &str = "\
## What the figures mean

- **FLIP** is the difference that a person perceives between two pictures, from 0 to 1, as a mean
  over all pixels (`andersson2020` in [the references](../references.md)). 0.01 is hard to see even
  when the pictures are flipped; 0.1 is seen at once.
- **The reference** is the exact surfaces where the scene is analytic. Elsewhere it is EWA splatting
  of all points at twice the resolution, which favours the method `ewa`: the page of a scene has
  the error against a reference by the same method, too.
- **The floor** is the error of the reference against itself, the camera moved by a step of the
  coordinates. Differences below it mean nothing.
- **Times** are medians of five frames on the CPU, without reading the file; bars in the plots are
  quartiles. They hold for the machine that is named above, and ratios of them for others, too.
- **Settings** are options of `esker render`. `enlarged` means that the picture is drawn smaller and
  enlarged; `--budget-ms` chooses such a resolution itself. `built with` names an option of
  `esker build`.

## How to renew

```sh
ESKER_DATA=FOLDER cargo xtask report
```

measures all scenes and runs `esker bench stability`; `cargo xtask report creek` measures one
scene. Scenes whose scan is not in the project are left as they are where `ESKER_DATA` is not set.
The reports go to a folder of [bench/results](../../bench/results/README.md);
`cargo xtask compare OLD NEW` compares two of those. [Injected faults](faults.md) shows that the
bounds of `esker bench stability` find mistakes. For a scan of your own:

```sh
esker bench error-time SCAN --out FOLDER
```
";

/// Makes the page.
///
/// # Errors
/// If figures of a scene lack a field.
pub fn text(scenes: &[Scene], evidence: &Map<String, Value>) -> Result<String> {
    let measured: Vec<(&Scene, &Value)> =
        scenes.iter().filter_map(|scene| Some((scene, evidence.get(&scene.name)?))).collect();
    let mut page = HEAD.to_owned();
    if let Some(note) = runs(&measured) {
        page += &format!("\n{}\n", wrapped(&note));
    }
    page += "\nThe least error at a frame time, of the settings that users have:\n\n";
    page += "| scene | kind | points | floor | 16 ms | 33 ms | 66 ms |\n";
    page += "|---|---|---:|---:|---|---|---|\n";
    for (scene, figures) in &measured {
        page += &row(scene, figures).with_context(|| scene.name.clone())?;
    }
    for (scene, figures) in &measured {
        page += &section(scene, figures).with_context(|| scene.name.clone())?;
    }
    Ok(page + "\n" + TAIL)
}

/// A sentence on where and when the scenes were measured: one for all, or one for each run.
fn runs(measured: &[(&Scene, &Value)]) -> Option<String> {
    let of = |figures: &Value| {
        let word = |key: &str| figures[key].as_str().unwrap_or("-").to_owned();
        [word("date"), word("machine"), word("commit")]
    };
    let mut all: Vec<([String; 3], Vec<&str>)> = Vec::new();
    for (scene, figures) in measured {
        let run = of(figures);
        match all.iter_mut().find(|(known, _)| *known == run) {
            Some((_, names)) => names.push(&scene.name),
            None => all.push((run, vec![&scene.name])),
        }
    }
    let is_one = all.len() == 1;
    let sentence = |([date, machine, commit], names): &([String; 3], Vec<&str>)| {
        let what = if is_one { "All scenes".to_owned() } else { names.join(", ") };
        format!("{what}: measured on {date} on the machine `{machine}`, commit `{commit}`.")
    };
    (!all.is_empty()).then(|| all.iter().map(sentence).collect::<Vec<_>>().join(" "))
}

/// A row of the table.
fn row(scene: &Scene, figures: &Value) -> Result<String> {
    let Scene { name, kind, .. } = scene;
    let points = grouped(figures["points"].as_u64().context("no points")?);
    let floor = figures["floor_flip"].as_f64().context("no floor")?;
    let advice = figures["advice"].as_array().context("no advice")?;
    let cell = |advice: &Value| match (advice["options"].as_str(), advice["flip"].as_f64()) {
        (Some(options), Some(flip)) => format!("{}: {flip:.3}", code(options)),
        _ => "-".to_owned(),
    };
    let cells: Vec<String> = advice.iter().map(cell).collect();
    Ok(format!(
        "| [{name}]({name}.html) | {kind} | {points} | {floor:.3} | {} |\n",
        cells.join(" | ")
    ))
}

/// Options as code; what stands in brackets or after a comma is for people.
fn code(options: &str) -> String {
    let end = options.find([',', '(']).unwrap_or(options.len());
    let (words, rest) = options.split_at(end);
    let space = if words.ends_with(' ') { " " } else { "" };
    format!("`{}`{space}{rest}", words.trim_end())
}

/// The section of a scene.
fn section(scene: &Scene, figures: &Value) -> Result<String> {
    let Scene { name, kind, about, .. } = scene;
    let size = figures["size"].as_array().context("no size")?;
    let size: Vec<String> = size.iter().map(Value::to_string).collect();
    let what = format!("{about} {} pixels.", size.join(" x "));
    let advice = figures["advice"].as_array().context("no advice")?;
    let advice = advice.iter().find(|one| one["budget_ms"] == ADVISED_MS);
    let advice = sentence(advice.context("no advice for a frame time")?, figures)?;
    let beyond = beyond(figures).map_or(String::new(), |text| format!("{}\n\n", wrapped(&text)));
    Ok(format!(
        "\n## {name}: {kind}\n\n{}\n\n{}\n\n{beyond}![Error against milliseconds a frame]({name}.svg)\n\n\
         [All settings, pictures and loading]({name}.html)\n",
        wrapped(&what),
        wrapped(&advice)
    ))
}

/// A sentence on what to draw with, beside the fastest and the best method with their defaults.
fn sentence(advice: &Value, figures: &Value) -> Result<String> {
    let number =
        |value: &Value, key: &str| value[key].as_f64().with_context(|| format!("no {key}"));
    let head = match advice["options"].as_str() {
        Some(options) => format!(
            "**At {ADVISED_MS:.0} ms a frame draw with {}**: {:.1} ms, FLIP {:.3}, {:.1} % of the \
             pixels visibly off.",
            code(options),
            number(advice, "ms")?,
            number(advice, "flip")?,
            number(advice, "off_share")? * 100.0
        ),
        None => format!("**No setting takes less than {ADVISED_MS:.0} ms a frame.**"),
    };
    let methods = figures["methods"].as_object().context("no methods")?;
    let mut each = Vec::new();
    for (method, own) in methods {
        let (ms, flip) = (number(own, "ms")?, number(own, "flip")?);
        each.push(format!("`{method}` {ms:.1} ms and {flip:.3}"));
    }
    Ok(format!("{head} Methods with their defaults: {}.", each.join(", ")))
}

/// The conditions of a scan that are beyond what pictures are rated to; none if there is none.
fn beyond(figures: &Value) -> Option<String> {
    let rows = figures.pointer("/conditions/conditions")?.as_array()?;
    let of_row = |row: &Value| {
        let all = row["rated"].as_array()?.iter().filter(|rated| rated["is_within"] == false);
        let rated: Vec<String> = all
            .map(|rated| {
                let (method, measure) = (rated["method"].as_str(), rated["measure"].as_str());
                let measure = measure.unwrap_or("-").split(',').next().unwrap_or("-");
                format!("{} of `{}` {}", measure, method.unwrap_or("-"), rated["rated_to"])
            })
            .collect();
        let (name, hardest) = (row["condition"].as_str()?, row["hardest"].as_f64()?);
        let value = if hardest < 10.0 { format!("{hardest:.1}") } else { format!("{hardest:.0}") };
        (!rated.is_empty()).then(|| format!("{name} {value} (rated: {})", rated.join(", ")))
    };
    let all: Vec<String> = rows.iter().filter_map(of_row).collect();
    let text = all.join("; ");
    let link = "[limits](../limits.md)";
    (!all.is_empty())
        .then(|| format!("More difficult than pictures are rated to ({link}): {text}."))
}

/// Text in lines of at most [`COLUMNS`] characters.
fn wrapped(text: &str) -> String {
    let mut lines = vec![String::new()];
    let mut count = 0;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if count > 0 && count + 1 + length > COLUMNS {
            lines.push(String::new());
            count = 0;
        }
        if let Some(line) = lines.last_mut() {
            if count > 0 {
                line.push(' ');
                count += 1;
            }
            line.push_str(word);
            count += length;
        }
    }
    lines.join("\n")
}

/// A number with commas between thousands.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn scene(name: &str) -> Scene {
        let value = json!({"name": name, "kind": "airborne", "about": "A valley.",
                           "scan": "tests/sample/creek.laz", "size": "640x400"});
        Scene::of(&value).expect("a scene")
    }

    fn figures(date: &str) -> Value {
        let best = |ms: f64| {
            json!({"budget_ms": ms, "options": "--method ewa --size 320x200, enlarged",
            "ms": 12.5, "cpu_ms": 20.0, "flip": 0.0312, "off_share": 0.125})
        };
        let none = json!({"budget_ms": 16.0, "options": null, "ms": null, "flip": null});
        let rated = |is_within: bool| {
            json!({"method": "ewa", "measure": "depth, px", "rated_to": 0.2,
            "is_within": is_within})
        };
        let conditions = json!({"conditions": [
            {"condition": "noise", "hardest": 0.35, "rated": [rated(false), rated(true)]},
            {"condition": "step", "hardest": 0.1, "rated": [rated(true)]}
        ]});
        json!({"conditions": conditions, "date": date, "machine": "2core", "commit": "0a1b2c3", "points": 841_952,
               "size": [640, 400], "floor_flip": 0.011, "advice": [none, best(33.0), best(66.0)],
               "methods": {"ewa": {"ms": 40.0, "flip": 0.02}}})
    }

    #[test]
    fn a_page_has_a_row_and_a_section_for_each_scene_that_was_measured() {
        let scenes = [scene("creek"), scene("later")];
        let evidence = Map::from_iter([("creek".to_owned(), figures("2026-11-29"))]);
        let page = text(&scenes, &evidence).expect("a page");
        let row = "| [creek](creek.html) | airborne | 841,952 | 0.011 | - | \
                   `--method ewa --size 320x200`, enlarged: 0.031 | \
                   `--method ewa --size 320x200`, enlarged: 0.031 |\n";
        assert!(page.contains(row), "{page}");
        assert!(page.contains("\n## creek: airborne\n") && !page.contains("later"), "{page}");
        assert!(
            page.contains("**At 33 ms a frame draw with `--method ewa --size 320x200`, enlarged**")
        );
        let words = page.split_whitespace().collect::<Vec<_>>().join(" ");
        let beyond = "rated to ([limits](../limits.md)): noise 0.3 (rated: depth of `ewa` 0.2). ![";
        assert!(words.contains(beyond), "{page}");
        assert!(words.contains("12.5 ms, FLIP 0.031, 12.5 % of the pixels visibly off"), "{page}");
        assert!(page.contains("All scenes: measured on 2026-11-29 on the machine `2core`"));
        let is_table = |line: &str| line.starts_with('|');
        assert!(page.lines().all(|line| is_table(line) || line.chars().count() <= COLUMNS));
    }

    #[test]
    fn scenes_of_different_runs_name_each() {
        let scenes = [scene("a"), scene("b")];
        let runs = [("a", "2026-11-28"), ("b", "2026-11-29")];
        let evidence = runs.map(|(name, date)| (name.to_owned(), figures(date)));
        let page = text(&scenes, &Map::from_iter(evidence)).expect("a page");
        assert!(page.contains("a: measured on 2026-11-28"), "{page}");
        assert!(
            page.contains("b: measured on\n2026-11-29")
                || page.contains("b: measured on 2026-11-29")
        );
        let broken = Map::from_iter([("a".to_owned(), json!({}))]);
        assert!(text(&scenes, &broken).is_err());
    }

    #[test]
    fn lines_are_wrapped_and_numbers_grouped() {
        assert!(wrapped(&"word ".repeat(50)).lines().all(|line| line.len() <= COLUMNS));
        assert_eq!([0, 999, 1000, 27_571_404].map(grouped), ["0", "999", "1,000", "27,571,404"]);
        assert_eq!(
            code("--method ewa (built with --tangents)"),
            "`--method ewa` (built with --tangents)"
        );
    }
}
