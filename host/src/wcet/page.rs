//! The report as one page that needs nothing else: tables and drawings in the order of what a reader has to be told.

mod plots;
mod sections;

use super::report::Report;

const STYLE: &str = "body{font:15px/1.5 Helvetica,Arial,sans-serif;color:#2a2f36;max-width:960px;margin:2em auto;padding:0 1.2em}\
h1{font-size:1.7em;margin-bottom:.2em}h2{font-size:1.2em;margin:2.2em 0 .5em;border-bottom:1px solid #d6dae0;padding-bottom:.25em}\
h3{font-size:1em;margin:1.4em 0 .4em}table{border-collapse:collapse;margin:.6em 0;font-size:.88em;font-variant-numeric:tabular-nums}\
td,th{padding:.25em .7em;text-align:right;border-bottom:1px solid #e9ecf0;vertical-align:top}th{color:#5b6472;font-weight:600}\
td:first-child,th:first-child,td.l,th.l{text-align:left}.wide{overflow-x:auto}code,.m{font-family:ui-monospace,Menlo,monospace;font-size:.86em;\
overflow-wrap:anywhere}.no{color:#b3261e;font-weight:700}.yes{color:#2a7a4b;font-weight:700}.note{color:#5b6472;font-size:.92em}\
.big{display:flex;flex-wrap:wrap;gap:.8em;margin:1.2em 0}.big div{border:1px solid #d6dae0;border-radius:6px;padding:.6em 1em;flex:1 1 140px}\
.big b{display:block;font-size:1.3em}.big span{color:#5b6472;font-size:.85em}svg{max-width:100%;height:auto}.wide svg{min-width:640px}td,th{white-space:nowrap}td.l{white-space:normal}\
details{margin:.6em 0}summary{cursor:pointer;color:#1f6fb4}nav a{margin-right:1em;white-space:nowrap}";

/// The page.
pub fn html(report: &Report) -> String {
    let mut body = sections::head(report);
    let titles_and_texts = [
        ("1", "Program and machine", sections::machine(report)),
        ("2", "Input space, loops, coverage", sections::inputs(report)),
        ("3", "Instructions", sections::instructions(report)),
        ("4", "Times", sections::times(report)),
        ("5", "Search for the worst input", sections::search(report)),
        ("6", "Stack", sections::stack(report)),
        ("7", "What cannot happen", sections::proofs(report)),
        ("8", "Extreme values", sections::evt(report)),
        ("9", "Response time and deadline misses", sections::responses(report)),
        ("10", "Margins", sections::margins(report)),
        ("11", "Limits of the method", sections::limits(report)),
    ];
    body += "<nav>";
    for (number, title, _) in &titles_and_texts {
        body += &format!("<a href=\"#s{number}\">{number} {title}</a> ");
    }
    body += "</nav>\n";
    for (number, title, text) in titles_and_texts {
        body += &format!("<h2 id=\"s{number}\">{number}. {title}</h2>\n{text}");
    }
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>Screed: worst-case report</title><style>{STYLE}</style></head><body>\n{body}</body></html>\n"
    )
}

/// Text that means nothing to a browser.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A table; `left` says how many of the first columns hold words.
fn table(head: &[&str], rows: &[Vec<String>], left: usize) -> String {
    let class = |k: usize| if k < left { " class=\"l\"" } else { "" };
    let mut out = "<div class=\"wide\"><table><tr>".to_owned();
    let head = if head.iter().all(|cell| cell.is_empty()) { &[] } else { head };
    for (k, cell) in head.iter().enumerate() {
        out += &format!("<th{}>{cell}</th>", class(k));
    }
    out += "</tr>\n";
    for row in rows {
        out += "<tr>";
        for (k, cell) in row.iter().enumerate() {
            out += &format!("<td{}>{cell}</td>", class(k));
        }
        out += "</tr>\n";
    }
    out + "</table></div>\n"
}

#[cfg(test)]
mod tests;
