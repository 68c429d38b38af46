//! Photographs with marks on them: a JPEG image and vector graphics in its pixel coordinates. They are widgets of a page.

use super::{chart::Colour, html::escape};
use data_encoding::BASE64;
use std::fmt::Write as _;

/// Length of the two lines of an arrowhead, relative to the arrow, and their longest length (pixels).
const HEAD: (f64, f64) = (0.35, 14.0);

/// Style of pictures; colours and rows are those of the page.
const STYLE: &str = "\
.picture{margin:14px 0;min-width:0}
.picture figcaption{font-weight:600;font-size:15px;margin:0 0 2px}
.picture .legend{display:flex;flex-wrap:wrap;gap:2px 14px;font-size:13.5px;margin:0 0 4px}
.picture .key{display:inline-block;width:11px;height:11px;border:2px solid;border-radius:50%;margin-right:6px;vertical-align:middle}
.picture svg{display:block;width:100%;max-width:1280px;height:auto;border-radius:4px}
.picture circle,.picture polyline{fill:none;stroke-width:1.6px;vector-effect:non-scaling-stroke;stroke-linejoin:round}";

/// Markup of pictures side by side where there is room, for [`Page::widget`](super::Page::widget).
#[must_use]
pub fn pictures(all: &[Picture]) -> String {
    let html: String = all.iter().map(Picture::html).collect();
    format!("<style>{STYLE}</style><div class=\"row\">{html}</div>")
}

/// Image with marks. Marks have column and row as coordinates; pixel centres are whole numbers.
#[derive(Debug, Clone)]
pub struct Picture {
    caption: String,
    jpeg: Vec<u8>,
    size_px: [usize; 2],
    marks: String,
    legend: Vec<(String, Colour)>,
}

impl Picture {
    /// Image of `size_px` (columns, rows) under a caption, without marks.
    #[must_use]
    pub fn new(caption: &str, jpeg: Vec<u8>, size_px: [usize; 2]) -> Self {
        Self {
            caption: caption.to_owned(),
            jpeg,
            size_px,
            marks: String::new(),
            legend: Vec::new(),
        }
    }

    /// Add an entry of the legend.
    #[must_use]
    pub fn with_entry(mut self, name: &str, colour: Colour) -> Self {
        self.legend.push((name.to_owned(), colour));
        self
    }

    fn push(&mut self, mark: std::fmt::Arguments<'_>) {
        self.marks.write_fmt(mark).unwrap_or_else(|_grows| unreachable!("a String grows"));
    }

    /// Add a circle.
    pub fn ring(&mut self, [x, y]: [f64; 2], radius_px: f64, colour: Colour) {
        let colour = colour.name();
        self.push(format_args!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius_px:.1}\" stroke=\"var(--{colour})\"/>"
        ));
    }

    /// Add lines through `points`.
    pub fn lines(&mut self, points: &[[f64; 2]], colour: Colour) {
        let points: String = points.iter().map(|[x, y]| format!("{x:.1},{y:.1} ")).collect();
        let (points, colour) = (points.trim_end(), colour.name());
        self.push(format_args!("<polyline points=\"{points}\" stroke=\"var(--{colour})\"/>"));
    }

    /// Add an arrow.
    pub fn arrow(&mut self, from: [f64; 2], to: [f64; 2], colour: Colour) {
        let along = [to[0] - from[0], to[1] - from[1]];
        let length = along[0].hypot(along[1]);
        if length < 1e-6 {
            return;
        }
        let head = (HEAD.0 * length).min(HEAD.1) / length;
        let end = |side: f64| {
            [
                to[0] - head * (along[0] + side * along[1]),
                to[1] - head * (along[1] - side * along[0]),
            ]
        };
        self.lines(&[from, to, end(0.6), to, end(-0.6)], colour);
    }

    /// Markup of the picture.
    fn html(&self) -> String {
        let [width, height] = self.size_px;
        let caption = escape(&self.caption);
        let entry = |(name, colour): &(String, Colour)| {
            let (name, colour) = (escape(name), colour.name());
            format!(
                "<span><i class=\"key ring\" style=\"border-color:var(--{colour})\"></i>{name}</span>"
            )
        };
        let legend: String = self.legend.iter().map(entry).collect();
        // The centre of the first pixel is (0, 0).
        format!(
            "<figure class=\"picture\"><figcaption>{caption}</figcaption><div class=\"legend\">{legend}</div>\n\
             <svg viewBox=\"-0.5 -0.5 {width} {height}\" role=\"img\" aria-label=\"{caption}\">\
             <image x=\"-0.5\" y=\"-0.5\" width=\"{width}\" height=\"{height}\" \
             href=\"data:image/jpeg;base64,{}\"/>{}</svg></figure>\n",
            BASE64.encode(&self.jpeg),
            self.marks
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_lie_in_pixel_coordinates_and_text_is_escaped() {
        let mut picture = Picture::new("a < b", vec![0xff, 0xd8], [1280, 720]);
        picture.ring([12.25, 7.0], 4.0, Colour::Blue);
        picture.arrow([0.0, 0.0], [10.0, 0.0], Colour::Red);
        picture.arrow([5.0, 5.0], [5.0, 5.0], Colour::Red);
        let html = picture.with_entry("<i>", Colour::Blue).html();
        assert!(html.contains("a &lt; b") && html.contains("&lt;i&gt;"), "{html}");
        assert!(html.contains("viewBox=\"-0.5 -0.5 1280 720\""), "{html}");
        assert!(html.contains("cx=\"12.2\" cy=\"7.0\""), "{html}");
        assert!(html.contains("points=\"0.0,0.0 10.0,0.0 6.5,2.1 10.0,0.0 6.5,-2.1\""), "{html}");
        assert!(html.contains("base64,/9g="), "{html}");
        assert_eq!(html.matches("<polyline").count(), 1, "an arrow without length is no mark");
    }
}
