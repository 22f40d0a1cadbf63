//! Reads what the rules need of Markdown: prose without fenced code, code spans, and anchors of
//! headings.

use std::collections::{BTreeMap, BTreeSet};

/// The text with the lines of fenced code blank; of the same length and lines.
pub fn without_fences(text: &str) -> String {
    let mut prose = String::with_capacity(text.len());
    let mut fence: Option<&str> = None;
    for line in text.split_inclusive('\n') {
        let mark = fence_of(line);
        let is_prose = fence.is_none() && mark.is_none();
        match (fence, mark) {
            (None, Some(_)) => fence = mark,
            (Some(open), Some(close)) if close.starts_with(open) && line.trim() == close => {
                fence = None;
            }
            _ => {}
        }
        if is_prose {
            prose.push_str(line);
        } else {
            prose.extend(line.bytes().map(|b| if b == b'\n' { '\n' } else { ' ' }));
        }
    }
    prose
}

/// The characters that open or close a fence in a line: three or more backticks or tildes.
fn fence_of(line: &str) -> Option<&str> {
    let line = line.trim();
    let mark = line.chars().next().filter(|c| "`~".contains(*c))?;
    let rest = line.trim_start_matches(mark);
    let length = line.len() - rest.len();
    (length >= 3 && !rest.contains('`')).then(|| &line[..length])
}

/// A code span: the offset of its first backtick, the length with backticks, the text between them.
pub struct Span<'a> {
    pub offset: usize,
    pub length: usize,
    pub text: &'a str,
}

/// Code spans of prose; a span does not reach over a blank line.
pub fn spans(prose: &str) -> Vec<Span<'_>> {
    let mut spans = Vec::new();
    let mut at = 0;
    while let Some(found) = prose[at..].find('`') {
        let offset = at + found;
        let ticks = ticks_at(prose, offset);
        let inside = offset + ticks;
        at = inside;
        if let Some(end) = closing_ticks(prose, inside, ticks) {
            spans.push(Span { offset, length: end + ticks - offset, text: &prose[inside..end] });
            at = end + ticks;
        }
    }
    spans
}

fn ticks_at(prose: &str, at: usize) -> usize {
    prose[at..].bytes().take_while(|b| *b == b'`').count()
}

/// Offset of the run of exactly `ticks` backticks that closes a span.
fn closing_ticks(prose: &str, from: usize, ticks: usize) -> Option<usize> {
    let end = prose[from..].find("\n\n").map_or(prose.len(), |e| from + e);
    let mut at = from;
    while let Some(found) = prose[at..end].find('`') {
        at += found;
        match ticks_at(prose, at) {
            n if n == ticks => return Some(at),
            n => at += n,
        }
    }
    None
}

/// Prose with its code spans blank, backticks included; of the same length and lines.
pub fn without_spans(prose: &str) -> String {
    let mut bytes = prose.as_bytes().to_vec();
    for span in spans(prose) {
        let range = &mut bytes[span.offset..span.offset + span.length];
        range.iter_mut().filter(|b| **b != b'\n').for_each(|b| *b = b' ');
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Anchors of a Markdown text: of its headings, as GitHub makes them, and of `id` and `name`
/// attributes.
pub fn anchors(text: &str) -> BTreeSet<String> {
    let prose = without_fences(text);
    let mut anchors = BTreeSet::new();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for heading in prose.lines().filter_map(heading) {
        let slug = slug(heading);
        let count = counts.entry(slug.clone()).or_default();
        anchors.insert(if *count == 0 { slug } else { format!("{slug}-{count}") });
        *count += 1;
    }
    for attribute in ["id=\"", "name=\""] {
        let values = prose.split(attribute).skip(1).filter_map(|rest| rest.split('"').next());
        anchors.extend(values.map(str::to_owned));
    }
    anchors
}

/// Text of a heading of the form `# Text`.
pub fn heading(line: &str) -> Option<&str> {
    let rest = line.trim_start_matches('#');
    let level = line.len() - rest.len();
    let is_heading = (1..=6).contains(&level) && rest.starts_with(' ');
    is_heading.then(|| rest.trim().trim_end_matches('#').trim())
}

/// Lower case, spaces as hyphens, without punctuation; of a link its text only.
fn slug(heading: &str) -> String {
    let mut text = heading.to_owned();
    while let Some(from) = text.find("](") {
        let end = text[from..].find(')').map_or(text.len(), |e| from + e + 1);
        text.replace_range(from..end, "");
    }
    let kept = text.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fences_are_blank() {
        let text = "a\n```rust\n# b\n~~~\n```\nc\n";
        assert_eq!(without_fences(text).split_whitespace().collect::<String>(), "ac");
        assert_eq!(without_fences(text).len(), text.len());
    }

    #[test]
    fn spans_may_wrap_but_not_over_paragraphs() {
        let texts = |t: &'static str| spans(t).iter().map(|s| s.text).collect::<Vec<_>>();
        assert_eq!(texts("`a` and `b\nc` and ``d`e``"), ["a", "b\nc", "d`e"]);
        assert_eq!(texts("one ` tick\n\n`a`"), ["a"]);
        assert_eq!(without_spans("a `b` c"), "a     c");
    }

    #[test]
    fn anchors_are_those_of_github() {
        let text = "# A frame, step by step\n## `esker build`\n## [Text](a.md) twice\n\
                    ## Text twice\n```\n# no\n```\n#no\n<a id=\"own\"></a>\n";
        let expected = ["a-frame-step-by-step", "esker-build", "own", "text-twice", "text-twice-1"];
        assert_eq!(anchors(text).into_iter().collect::<Vec<_>>(), expected);
    }
}
