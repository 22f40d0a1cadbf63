//! Bounds of a file's XML, found in one pass over its bytes before it is parsed. The parser takes
//! time with the square of an element's attributes, and with the cube of the depth where each level
//! declares a namespace, and cannot be interrupted; a real file has a few of each.

/// Greatest depth of elements; the format defines about ten levels.
const DEPTH_MAX: usize = 100;
/// Greatest number of attributes of an element.
const ATTRIBUTES_MAX: usize = 100;
/// Greatest number of namespaces that an element and those around it declare.
const NAMESPACES_MAX: usize = 100;
/// Greatest number of elements: the parser takes some 200 bytes for each.
const ELEMENTS_MAX: usize = 1_000_000;

/// What a start tag has.
struct Tag {
    attributes: usize,
    namespaces: usize,
    is_empty: bool,
}

/// Checks that `xml` can be parsed in reasonable time. What is no well-formed XML is left to the
/// parser, which refuses it.
///
/// # Errors
/// The bound that is exceeded.
pub fn check(xml: &[u8]) -> Result<(), String> {
    let too_many = |what: &str, max: usize| {
        Err(format!("its XML {what} than the {max} that Esker reads; it is damaged, or no scan"))
    };
    // Namespaces that each open element declares.
    let mut open: Vec<usize> = Vec::new();
    let (mut namespaces, mut elements) = (0, 0);
    let mut rest = xml;
    while let Some(at) = rest.iter().position(|&b| b == b'<') {
        rest = &rest[at..];
        if let Some((opening, closing)) = PASSIVE.iter().find(|(o, _)| rest.starts_with(o)) {
            rest = behind(&rest[opening.len()..], closing);
        } else if rest.starts_with(b"</") {
            namespaces -= open.pop().unwrap_or_default();
            rest = behind(rest, b">");
        } else {
            let (tag, after) = read_tag(&rest[1..]);
            rest = after;
            elements += 1;
            if elements > ELEMENTS_MAX {
                return too_many("has more elements", ELEMENTS_MAX);
            }
            if tag.attributes > ATTRIBUTES_MAX {
                return too_many("gives an element more attributes", ATTRIBUTES_MAX);
            }
            if namespaces + tag.namespaces > NAMESPACES_MAX {
                return too_many("declares more namespaces", NAMESPACES_MAX);
            }
            if tag.is_empty {
                continue;
            }
            if open.len() >= DEPTH_MAX {
                return too_many("nests elements deeper", DEPTH_MAX);
            }
            namespaces += tag.namespaces;
            open.push(tag.namespaces);
        }
    }
    Ok(())
}

/// Beginnings and ends of what has no elements.
const PASSIVE: [(&[u8], &[u8]); 4] =
    [(b"<!--", b"-->"), (b"<![CDATA[", b"]]>"), (b"<?", b"?>"), (b"<!", b">")];

/// The bytes behind the first `end`; none without one.
fn behind<'a>(bytes: &'a [u8], end: &[u8]) -> &'a [u8] {
    let at = bytes.windows(end.len()).position(|w| w == end);
    at.map_or(&[], |at| &bytes[at + end.len()..])
}

/// Reads a start tag from its name on; returns the bytes behind it.
fn read_tag(bytes: &[u8]) -> (Tag, &[u8]) {
    let mut tag = Tag { attributes: 0, namespaces: 0, is_empty: false };
    let (mut at, mut word) = (0, 0);
    while let Some(&byte) = bytes.get(at) {
        at += 1;
        match byte {
            b'>' => {
                tag.is_empty = at >= 2 && bytes[at - 2] == b'/';
                return (tag, &bytes[at..]);
            }
            b'=' => {
                tag.attributes += 1;
                tag.namespaces += usize::from(bytes[word..at].starts_with(b"xmlns"));
            }
            b'"' | b'\'' => {
                let length = bytes[at..].iter().position(|&b| b == byte);
                let Some(length) = length else { return (tag, &[]) };
                at += length + 1;
                // The next attribute may follow without a blank.
                word = at;
            }
            // A name may be separated from its `=` by blanks.
            _ if is_blank(byte)
                && bytes.get(at).is_some_and(|next| !is_blank(*next) && *next != b'=') =>
            {
                word = at;
            }
            _ => {}
        }
    }
    (tag, &[])
}

fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_documents_pass() {
        let text =
            br#"<?xml version="1.0"?><!-- <a> --><e57Root type='Structure' xmlns="a" xmlns:x = "b">
            <guid type="String"><![CDATA[<<<<]]></guid><empty a=">" b='"'/><x:y/></e57Root>"#;
        check(text).unwrap();
        let scan = "<s a='1'><t xmlns:n='u'>5</t></s>";
        check(format!("<r>{}</r>", scan.repeat(20_000)).as_bytes()).unwrap();
        for broken in ["<", "<a", "<a b=", "<a b='", "<!--", "</a></a>", "<![CDATA[", "<?", ""] {
            check(broken.as_bytes()).unwrap();
        }
    }

    #[test]
    fn depth_attributes_namespaces_and_elements_are_bounded() {
        let refused = |xml: String, what: &str| {
            let error = check(xml.as_bytes()).unwrap_err();
            assert!(error.contains(what), "{error}");
        };
        refused("<a>".repeat(101), "nests elements deeper");
        refused("<a xmlns:b='c' xmlns:d='e'>".repeat(51), "more namespaces");
        refused("<a\nxmlns:b ='c'\txmlns:d= 'e'>".repeat(51), "more namespaces");
        refused(format!("<a{}>", " b='1'".repeat(101)), "more attributes");
        refused(format!("<a {}>", "b='1'".repeat(101)), "more attributes");
        refused("<a/>".repeat(1_000_001), "more elements");
        check("<a xmlns:b='c'/>".repeat(1000).as_bytes()).unwrap();
    }

    #[test]
    fn the_check_takes_linear_time() {
        // Quadratic time would be hours.
        for text in ["<!--", "<a b='", "<a ", "< ", "<![CDATA[", "<a b=' ' ", "</"] {
            let result = check(text.repeat((4 << 20) / text.len()).as_bytes());
            assert!(result.is_ok() || text.starts_with("<a"), "{text}");
        }
    }
}
