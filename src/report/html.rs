//! Self-contained HTML page of headed sections, tables and charts.

use super::chart::Chart;
use std::fmt::Write as _;

/// Page under construction. Text before the first section is its introduction.
#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    badge: String,
    introduction: String,
    body: String,
    /// Titles of the sections, in order.
    sections: Vec<String>,
    charts: usize,
}

/// Tone of a badge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Badge {
    /// The result is as wanted.
    Good,
    /// The result is a plain statement.
    Note,
    /// The result needs attention.
    Warn,
    /// There is no result, or a bad one.
    Bad,
}

/// Rows of text cells under a header. Columns after the first are set flush right.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Column heads.
    pub head: Vec<String>,
    /// Cells, as many in each row as there are heads.
    pub rows: Vec<Vec<String>>,
}

const STYLE: &str = include_str!("page.css");

/// uPlot 1.6.32, MIT licence; see `vendor/README.md`.
const UPLOT: &str = include_str!("vendor/uplot.min.js");
const UPLOT_STYLE: &str = include_str!("vendor/uplot.min.css");
const CHARTS: &str = include_str!("chart.js");

/// Fewest sections of a page with a table of contents.
const LEAST_CONTENTS: usize = 3;

/// Return `text` with the characters that mean something to HTML replaced.
#[must_use]
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Return the identifier of a section: the small letters and digits of its title, joined by hyphens, after a prefix that
/// no widget uses.
fn anchor(title: &str) -> String {
    let words = title.split(|letter: char| !letter.is_ascii_alphanumeric());
    let words: Vec<String> =
        words.filter(|word| !word.is_empty()).map(str::to_ascii_lowercase).collect();
    format!("section-{}", words.join("-"))
}

impl Table {
    /// Table with these column heads.
    #[must_use]
    pub fn new(head: &[&str], rows: Vec<Vec<String>>) -> Self {
        Self { head: head.iter().map(|cell| (*cell).to_owned()).collect(), rows }
    }

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

impl Badge {
    fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Note => "note",
            Self::Warn => "warn",
            Self::Bad => "bad",
        }
    }
}

impl Page {
    /// Empty page.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            badge: String::new(),
            introduction: String::new(),
            body: String::new(),
            sections: Vec::new(),
            charts: 0,
        }
    }

    fn push(&mut self, html: std::fmt::Arguments<'_>) {
        let part = if self.sections.is_empty() { &mut self.introduction } else { &mut self.body };
        part.write_fmt(html).unwrap_or_else(|_grows| unreachable!("a String grows"));
    }

    /// Set the result in a word or two, shown next to the title.
    pub fn badge(&mut self, text: &str, tone: Badge) {
        self.badge = format!("<span class=\"badge {}\">{}</span>", tone.class(), escape(text));
    }

    /// Add a few key figures: name and value with unit.
    pub fn key_figures(&mut self, figures: &[(&str, String)]) {
        let figure = |(name, value): &(&str, String)| {
            format!("<div><dt>{}</dt><dd>{}</dd></div>", escape(name), escape(value))
        };
        let figures: String = figures.iter().map(figure).collect();
        self.push(format_args!("<dl class=\"figures\">{figures}</dl>\n"));
    }

    /// Start a section; it gets an entry in the table of contents.
    pub fn section(&mut self, title: &str) {
        let close = if self.sections.is_empty() { "" } else { "</section>\n" };
        self.sections.push(title.to_owned());
        let id = anchor(title);
        self.push(format_args!("{close}<section id=\"{id}\"><h2>{}</h2>\n", escape(title)));
    }

    /// Start a part of a section.
    pub fn subsection(&mut self, title: &str) {
        self.push(format_args!("<h3>{}</h3>\n", escape(title)));
    }

    /// Add a paragraph of plain text.
    pub fn paragraph(&mut self, text: &str) {
        self.push(format_args!("<p>{}</p>\n", escape(text)));
    }

    /// Add the sentence that a hurried reader should take away.
    pub fn lead(&mut self, text: &str) {
        self.push(format_args!("<p class=\"lead\">{}</p>\n", escape(text)));
    }

    /// Add a paragraph that stands out.
    pub fn warning(&mut self, text: &str) {
        self.push(format_args!("<p class=\"warning\">{}</p>\n", escape(text)));
    }

    /// Add text in a monospaced face.
    pub fn code(&mut self, text: &str) {
        self.push(format_args!("<p><code>{}</code></p>\n", escape(text)));
    }

    /// Add a link to a file in the folder of the page.
    pub fn link(&mut self, to: &str, text: &str) {
        self.push(format_args!("<p><a href=\"{}\">{}</a></p>\n", escape(to), escape(text)));
    }

    /// Add a table.
    pub fn table(&mut self, table: &Table) {
        let html = table.html("scroll");
        self.push(format_args!("{html}"));
    }

    /// Add a table whose last column holds words, which are set flush left and wrapped.
    pub fn table_of_words(&mut self, table: &Table) {
        let html = table.html("scroll words");
        self.push(format_args!("{html}"));
    }

    /// Add facts as such a table: a name and a value in each row.
    pub fn facts<const N: usize>(&mut self, facts: [(&str, String); N]) {
        let rows = facts.map(|(name, value)| vec![name.to_owned(), value]).into();
        self.table_of_words(&Table::new(&["property", "value"], rows));
    }

    /// Add such a table, shown when `summary` is clicked.
    pub fn folded_table_of_words(&mut self, summary: &str, table: &Table) {
        let (summary, html) = (escape(summary), table.html("scroll words"));
        self.push(format_args!("<details><summary>{summary}</summary>{html}</details>\n"));
    }

    /// Add a chart over the whole width.
    pub fn chart(&mut self, chart: &Chart) {
        self.charts += 1;
        let html = chart.html();
        self.push(format_args!("{html}"));
    }

    /// Add charts side by side where there is room.
    pub fn charts(&mut self, charts: &[Chart]) {
        let html = self.joined(charts);
        self.push(format_args!("<div class=\"row\">{html}</div>\n"));
    }

    /// Add charts that are shown when `summary` is clicked.
    pub fn folded_charts(&mut self, summary: &str, charts: &[Chart]) {
        let (summary, html) = (escape(summary), self.joined(charts));
        self.push(format_args!(
            "<details><summary>{summary}</summary><div class=\"row\">{html}</div></details>\n"
        ));
    }

    fn joined(&mut self, charts: &[Chart]) -> String {
        self.charts += charts.len();
        charts.iter().map(Chart::html).collect()
    }

    /// Add markup that the program itself wrote, such as a script with its data.
    pub fn widget(&mut self, markup: &str) {
        self.push(format_args!("{markup}\n"));
    }

    fn contents(&self) -> String {
        if self.sections.len() < LEAST_CONTENTS {
            return String::new();
        }
        let link = |title: &String| format!("<a href=\"#{}\">{}</a>", anchor(title), escape(title));
        let links: String = self.sections.iter().map(link).collect();
        format!("<nav class=\"contents\"><b>Contents</b>{links}</nav>\n")
    }

    /// Return the whole document.
    #[must_use]
    pub fn finish(self) -> String {
        let title = escape(&self.title);
        let (uplot_style, scripts, hint) = match self.charts {
            0 => ("", String::new(), ""),
            _ => (
                UPLOT_STYLE,
                format!("<script>{UPLOT}</script>\n<script>\n{CHARTS}</script>\n"),
                "<p class=\"hint\">Charts: hover for values, drag to zoom, double-click to reset, click a name in a \
                 legend to hide its curve.</p>\n",
            ),
        };
        let close = if self.sections.is_empty() { "" } else { "</section>\n" };
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
             <title>{title}</title><style>{uplot_style}\n{STYLE}</style></head>\n<body><main>\n\
             <h1>{title}{}</h1>\n{}{}{hint}{}{close}</main>{scripts}</body></html>\n",
            self.badge,
            self.introduction,
            self.contents(),
            self.body
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Axis, Colour, Series};

    #[test]
    fn text_cannot_become_markup() {
        let mut page = Page::new("a <b>");
        page.badge("<i>", Badge::Good);
        page.key_figures(&[("<u>", "<s>".to_owned())]);
        page.paragraph("x < y & \"z\"");
        let html = page.finish();
        assert!(html.contains("<title>a &lt;b&gt;</title>"));
        assert!(html.contains("<p>x &lt; y &amp; &quot;z&quot;</p>"));
        assert!(!html.contains("<i>") && !html.contains("<u>") && !html.contains("<s>"));
    }

    #[test]
    fn contents_link_to_sections() {
        let mut page = Page::new("t");
        page.lead("first");
        for title in ["One & two", "Three", "Four"] {
            page.section(title);
        }
        let html = page.finish();
        assert!(html.contains("<a href=\"#section-one-two\">One &amp; two</a>"));
        assert!(html.contains("<section id=\"section-one-two\"><h2>One &amp; two</h2>"));
        assert_eq!(html.matches("<section").count(), html.matches("</section>").count());
        assert!(html.find("first").unwrap() < html.find("<nav").unwrap());
    }

    #[test]
    fn the_plotting_library_is_embedded_once_and_only_where_it_is_needed() {
        let mut page = Page::new("t");
        assert!(!page.clone().finish().contains("uPlot"));
        let axis = || Axis::new("time", "s");
        let chart = Chart::of_lines("c", axis(), axis());
        let chart = chart.with(Series::line("a", Colour::Blue, vec![(0.0, 1.0)]));
        page.charts(&[chart.clone(), chart]);
        let html = page.finish();
        assert_eq!(html.matches("var uPlot=").count(), 1);
        assert_eq!(html.matches("class=\"chart\"").count(), 2);
    }
}
