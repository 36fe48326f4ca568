//! Drawings as plain SVG text: a page, axes, lines and words.

/// The colour of lines and words.
pub const INK: &str = "#2a2f36";
const GRID: &str = "#e3e6ea";

/// The beginning of a drawing of that size on a white ground.
pub fn open(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         font-family=\"Helvetica, Arial, sans-serif\" font-size=\"13\" fill=\"{INK}\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    )
}

/// Axes: a rectangle of the page and the ranges of values it shows.
pub struct Axes {
    /// Left, top, width and height on the page.
    pub page: [f64; 4],
    /// From left to right.
    pub x: [f64; 2],
    /// From bottom to top.
    pub y: [f64; 2],
}

impl Axes {
    /// Where a value is on the page.
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let [left, top, width, height] = self.page;
        let share = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        [left + width * share(x, self.x), top + height * (1.0 - share(y, self.y))]
    }

    /// Grid, frame, numbers and labels.
    pub fn draw(&self, out: &mut String, x_label: &str, y_label: &str) {
        let [left, top, width, height] = self.page;
        for value in ticks(self.x) {
            let [x, _] = self.at(value, self.y[0]);
            *out += &format!(
                "<path d=\"M{x:.1} {top}v{height}\" stroke=\"{GRID}\"/><path d=\"M{x:.1} {}v5\" stroke=\"{INK}\"/>\n",
                top + height
            );
            text(out, [x, top + height + 19.0], "middle", "font-size=\"11\"", &number(value));
        }
        for value in ticks(self.y) {
            let [_, y] = self.at(self.x[0], value);
            *out += &format!(
                "<path d=\"M{left} {y:.1}h{width}\" stroke=\"{GRID}\"/><path d=\"M{left} {y:.1}h-5\" stroke=\"{INK}\"/>\n"
            );
            text(out, [left - 9.0, y + 4.0], "end", "font-size=\"11\"", &number(value));
        }
        *out += &format!(
            "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"{INK}\"/>\n"
        );
        text(out, [left + 0.5 * width, top + height + 42.0], "middle", "", x_label);
        let middle = [left - 48.0, top + 0.5 * height];
        let turn = format!("transform=\"rotate(-90 {:.1} {:.1})\"", middle[0], middle[1]);
        text(out, middle, "middle", &turn, y_label);
    }
}

/// Round values inside a range, four to nine of them: 1, 2 or 5 times a power of ten apart.
pub fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let rough = (high - low) / 8.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= rough);
    let Some(step) = step.filter(|step| *step > 0.0 && step.is_finite()) else { return Vec::new() };
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).take(20).map(|i| i as f64 * step).collect()
}

/// A number with at most six decimals.
pub fn number(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    // Not "-0".
    format!("{}", rounded + 0.0)
}

/// A line through points of the page.
pub fn polyline(out: &mut String, points: &[[f64; 2]], stroke: &str, width: f64) {
    if points.len() < 2 {
        return;
    }
    *out += &format!("<path stroke=\"{stroke}\" stroke-width=\"{width}\" fill=\"none\" stroke-linecap=\"round\" d=\"");
    for (i, [x, y]) in points.iter().enumerate() {
        *out += &format!("{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' });
    }
    *out += "\"/>\n";
}

/// Words at a place of the page, `anchor` being start, middle or end.
pub fn text(out: &mut String, [x, y]: [f64; 2], anchor: &str, attributes: &str, text: &str) {
    if text.is_empty() {
        return;
    }
    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    // Control characters, which a model's names may hold, are not allowed in XML.
    let escaped: String = escaped.chars().filter(|c| !c.is_control()).collect();
    *out += &format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" {attributes}>{escaped}</text>\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks([0.0, 70.0]), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0]);
        assert_eq!(ticks([-0.3, 0.31]), [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0].map(|i| i * 0.1));
        assert!(ticks([1.0, 1.0]).is_empty() && ticks([f64::NAN, 1.0]).is_empty());
    }
}
