//! A self-contained HTML page of headed sections, tables and pictures.

use std::fmt::Write as _;

/// A page under construction.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    body: String,
}

/// Rows of text cells under a header. Columns after the first are set flush right.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Column heads.
    pub head: Vec<String>,
    /// Cells, as many in each row as there are heads.
    pub rows: Vec<Vec<String>>,
}

const STYLE: &str = "
:root{color-scheme:light}
body{font:16px/1.5 system-ui,sans-serif;color:#1d2733;background:#f6f7f9;margin:0}
main{max-width:1080px;margin:0 auto;padding:24px 20px 60px;background:#fff}
h1{font-size:28px;margin:8px 0 4px}
h2{font-size:20px;margin:36px 0 8px;border-bottom:1px solid #d9dee5;padding-bottom:4px}
h3{font-size:17px;margin:22px 0 4px}
p{max-width:78ch}
.lead{font-size:18px}
.warning{background:#fff4dc;border-left:4px solid #d9902f;padding:8px 12px;margin:8px 0;max-width:76ch}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:13.5px;margin:8px 0}
th,td{padding:3px 7px;text-align:right;border-bottom:1px solid #e6e9ee;white-space:nowrap}
th{white-space:normal;vertical-align:bottom}
th:first-child,td:first-child{text-align:left}
th{background:#eef1f5}
.words th:last-child,.words td:last-child{text-align:left;white-space:normal;min-width:22ch}
svg{max-width:100%;height:auto;display:block;margin:8px 0}
.row{display:flex;flex-wrap:wrap;gap:8px}
.row svg{flex:1 1 440px;max-width:490px}
.key{display:inline-block;width:22px;height:4px;margin:0 6px 3px 14px;vertical-align:middle}
.key:first-child{margin-left:0}
details{margin:6px 0}
summary{cursor:pointer;font-weight:600}
code{background:#eef1f5;padding:1px 4px;border-radius:3px;overflow-wrap:anywhere}
";

/// `text` with the characters that mean something to HTML replaced.
#[must_use]
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

impl Table {
    fn html(&self, class: &str) -> String {
        let row = |cells: &[String], tag: &str| {
            let cells: String =
                cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
            format!("<tr>{cells}</tr>\n")
        };
        let rows: String = self.rows.iter().map(|cells| row(cells, "td")).collect();
        let head = row(&self.head, "th");
        format!("<div class=\"{class}\"><table>\n{head}{rows}</table></div>\n")
    }
}

impl Page {
    /// An empty page.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self { title: title.to_owned(), body: String::new() }
    }

    fn push(&mut self, html: std::fmt::Arguments<'_>) {
        self.body.write_fmt(html).unwrap_or_else(|_grows| unreachable!("a String grows"));
    }

    /// Starts a section.
    pub fn section(&mut self, title: &str) {
        self.push(format_args!("<h2>{}</h2>\n", escape(title)));
    }

    /// Starts a part of a section.
    pub fn subsection(&mut self, title: &str) {
        self.push(format_args!("<h3>{}</h3>\n", escape(title)));
    }

    /// Adds a paragraph of plain text.
    pub fn paragraph(&mut self, text: &str) {
        self.push(format_args!("<p>{}</p>\n", escape(text)));
    }

    /// Adds the sentence that a hurried reader should take away.
    pub fn lead(&mut self, text: &str) {
        self.push(format_args!("<p class=\"lead\">{}</p>\n", escape(text)));
    }

    /// Adds a paragraph that stands out.
    pub fn warning(&mut self, text: &str) {
        self.push(format_args!("<p class=\"warning\">{}</p>\n", escape(text)));
    }

    /// Adds text in a typewriter face.
    pub fn code(&mut self, text: &str) {
        self.push(format_args!("<p><code>{}</code></p>\n", escape(text)));
    }

    /// Adds a link to a file beside the page.
    pub fn link(&mut self, to: &str, text: &str) {
        self.push(format_args!("<p><a href=\"{}\">{}</a></p>\n", escape(to), escape(text)));
    }

    /// Adds a table.
    pub fn table(&mut self, table: &Table) {
        let html = table.html("scroll");
        self.push(format_args!("{html}"));
    }

    /// Adds a table whose last column holds words, which are set flush left and wrapped.
    pub fn table_of_words(&mut self, table: &Table) {
        let html = table.html("scroll words");
        self.push(format_args!("{html}"));
    }

    /// Adds what is known as such a table: a name and a value in each row.
    pub fn facts<const N: usize>(&mut self, facts: [(&str, String); N]) {
        let head = ["what", "value"].map(str::to_owned).into();
        let rows = facts.map(|(name, value)| vec![name.to_owned(), value]).into();
        self.table_of_words(&Table { head, rows });
    }

    /// Adds such a table, shown when `summary` is clicked.
    pub fn folded_table_of_words(&mut self, summary: &str, table: &Table) {
        let (summary, html) = (escape(summary), table.html("scroll words"));
        self.push(format_args!("<details><summary>{summary}</summary>{html}</details>\n"));
    }

    /// Adds a picture, an SVG document.
    pub fn picture(&mut self, svg: &str) {
        self.push(format_args!("{svg}\n"));
    }

    /// Adds markup that the program itself wrote, such as a script with its data.
    pub fn widget(&mut self, markup: &str) {
        self.push(format_args!("{markup}\n"));
    }

    /// Adds pictures beside each other where there is room.
    pub fn pictures_in_row(&mut self, svgs: &[String]) {
        self.push(format_args!("<div class=\"row\">{}</div>\n", svgs.join("\n")));
    }

    /// Adds a legend: names with their colours (red, green, blue).
    pub fn legend(&mut self, entries: &[(&str, [u8; 3])]) {
        let entries: String = entries
            .iter()
            .map(|(name, [r, g, b])| {
                let key =
                    format!("<span class=\"key\" style=\"background:rgb({r},{g},{b})\"></span>");
                format!("{key}{}", escape(name))
            })
            .collect();
        self.push(format_args!("<p>{entries}</p>\n"));
    }

    /// Adds pictures that are shown when `summary` is clicked.
    pub fn folded_pictures(&mut self, summary: &str, svgs: &[String]) {
        let summary = escape(summary);
        let svgs = svgs.join("\n");
        self.push(format_args!("<details><summary>{summary}</summary>{svgs}</details>\n"));
    }

    /// The whole document.
    #[must_use]
    pub fn finish(self) -> String {
        let title = escape(&self.title);
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
             <title>{title}</title><style>{STYLE}</style></head>\n<body><main>\n<h1>{title}</h1>\n\
             {}</main></body></html>\n",
            self.body
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        let mut page = Page::new("a <b>");
        page.paragraph("x < y & \"z\"");
        let html = page.finish();
        assert!(html.contains("<title>a &lt;b&gt;</title>"));
        assert!(html.contains("<p>x &lt; y &amp; &quot;z&quot;</p>"));
    }
}
