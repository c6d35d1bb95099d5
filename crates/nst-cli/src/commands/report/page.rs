//! Puts the page together: one file, which a policy in its head keeps from all networks.

use base64::{Engine, engine::general_purpose::STANDARD};
use serde::Serialize;
use sha2::{Digest, Sha256};

/// The modules of the script, each after those that it imports.
const MODULES: [(&str, &str); 11] = [
    ("dom.js", include_str!("page/dom.js")),
    ("format.js", include_str!("page/format.js")),
    ("codec.js", include_str!("page/codec.js")),
    ("color.js", include_str!("page/color.js")),
    ("view.js", include_str!("page/view.js")),
    ("comparer.js", include_str!("page/comparer.js")),
    ("controls.js", include_str!("page/controls.js")),
    ("readout.js", include_str!("page/readout.js")),
    ("table.js", include_str!("page/table.js")),
    ("charts.js", include_str!("page/charts.js")),
    ("main.js", include_str!("page/main.js")),
];

/// A page of data that `page/main.js` reads, and of stored pictures by their names.
pub(super) fn page(data: &impl Serialize, pictures: &[(String, String)]) -> String {
    let script = script();
    let hash = STANDARD.encode(Sha256::digest(&script));
    let head = format!(
        "<!doctype html>\n\
         <html lang=\"en\">\n\
         <head>\n\
         <meta charset=\"utf-8\">\n\
         <meta name=\"generator\" content=\"nst {}\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
         img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{hash}'\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>nst report</title>\n\
         <link rel=\"icon\" href=\"data:,\">\n",
        env!("CARGO_PKG_VERSION")
    );
    let style = include_str!("page/style.css");
    let body = include_str!("page/page.html");
    let mut page = format!("{head}<style>\n{style}</style>\n</head>\n<body>\n{body}");
    page.push_str("<script type=\"application/json\" id=\"data\">");
    page.push_str(&json(data));
    page.push_str("</script>\n");
    for (name, text) in pictures {
        page.push_str(&format!("<script type=\"text/plain\" id=\"picture-{name}\">"));
        page.push_str(text);
        page.push_str("</script>\n");
    }
    page + "<script type=\"module\">" + &script + "</script>\n</body>\n</html>\n"
}

/// JSON that cannot end the element that it stands in: outside of strings JSON has no `<`, and
/// within them it may be written by its number.
fn json(data: &impl Serialize) -> String {
    let text = serde_json::to_string(data).expect("the data consist of numbers and texts");
    text.replace('<', "\\u003c")
}

/// The modules as one: a page cannot import what is in itself.
fn script() -> String {
    let mut script = String::new();
    for (name, text) in MODULES {
        script.push_str(&format!("\n// ---- {name}\n"));
        for line in text.lines().filter(|line| !line.starts_with("import ")) {
            script.push_str(line.strip_prefix("export ").unwrap_or(line));
            script.push('\n');
        }
    }
    script
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_follow_those_that_they_import() {
        for (index, (name, text)) in MODULES.iter().enumerate() {
            for line in text.lines().filter(|line| line.starts_with("import ")) {
                let from = line.split_once(" from \"./").and_then(|(_, rest)| rest.split_once('"'));
                let (from, _) = from.expect("an import from a file");
                let place = MODULES.iter().position(|(other, _)| *other == from);
                assert!(place.is_some_and(|place| place < index), "{name} imports {from}");
            }
        }
        assert!(!script().lines().any(|l| l.starts_with("import ") || l.starts_with("export ")));
        assert!(!script().contains("</script"));
    }

    #[test]
    fn names_cannot_end_the_data() {
        let name = "</script><script>alert(1)</script><!--";
        let page = page(&name, &[]);
        assert!(!page.contains("alert(1)</script>"));
        assert_eq!(serde_json::from_str::<String>(&json(&name)).expect("JSON"), name);
        assert_eq!(page.matches("<script").count(), 2);
    }
}
