//! How a frame becomes a line.

use crate::json::{key, string};
use crate::{Order, Real, Recorder, View, PARTS};
use std::fmt::Write as _;
use std::io::Write as _;

impl Recorder {
    /// Writes the frame.
    pub fn end_frame(&mut self) {
        if !self.may(Some(true)) {
            return;
        }
        self.open = false;
        let mut line = format!("{{\"frame\":{}", self.frame.unwrap_or(0));
        let (whole, views) = self.views.split_at(1);
        let seen = views.iter().all(|view| view.has_camera) && !views.is_empty();
        let two = |of: &dyn Fn(&View) -> bool| (of(&whole[0]), views.iter().any(of));
        let given = (
            two(&|view| view.visible.is_some()),
            two(&|view| view.nodes.is_some()),
        );
        let (nodes, by_view, clear) = match given {
            ((_, false), (false, false)) => (false, false, true),
            ((false, true), (false, false)) => (false, true, true),
            ((false, false), (true, false)) => (true, false, true),
            ((false, false), (false, true)) => (true, true, true),
            _ => (false, false, false),
        };
        let set = |view: &View| {
            if nodes {
                view.nodes.clone()
            } else {
                view.visible.clone()
            }
        };
        let list = |view: &View| format!("[{}]", set(view).unwrap_or_default());
        if !whole[0].fields.is_empty() {
            let _ = write!(line, ",{}", whole[0].fields);
        }
        let object = |one: &dyn Fn(&View) -> String| {
            let mut members = String::new();
            views
                .iter()
                .for_each(|view| key(&mut members, &view.name).push_str(&one(view)));
            format!("{{{members}}}")
        };
        if !views.is_empty() {
            let _ = write!(
                line,
                ",\"views\":{}",
                object(&|view| format!("{{{}}}", view.fields))
            );
        }
        let sets = if by_view {
            object(&list)
        } else {
            list(&whole[0])
        };
        key(&mut line, if nodes { "visible_nodes" } else { "visible" }).push_str(&sets);
        if !whole[0].has_camera && !seen {
            self.fail("no camera");
        }
        if !clear {
            self.fail("what is visible is given in two ways");
        }
        if !self.absent.is_empty() {
            let _ = write!(line, ",\"absent\":[{}]", self.absent);
        }
        if !self.parts[5].is_empty() {
            let ms = format!("{{{}}}", self.parts[5]);
            key(&mut self.parts[4], "ms").push_str(&ms);
        }
        (1..5).for_each(|i| self.end(i, &mut line));
        self.write(&line);
    }

    pub(crate) fn write_header(&mut self) {
        let start = "{\"format\":\"visref-recording\",\"version\":1";
        let mut line = format!("{start},{}", self.views[0].fields);
        self.end(0, &mut line);
        self.write(&line);
    }

    fn end(&self, i: usize, line: &mut String) {
        if !self.parts[i].is_empty() {
            let _ = write!(key(line, PARTS[i]), "{{{}}}", self.parts[i]);
        }
    }

    fn write(&mut self, line: &str) {
        if let (None, Some(file)) = (&self.problem, &mut self.file) {
            if let Err(error) = file.write_all(line.as_bytes()).and(file.write_all(b"}\n")) {
                self.fail(&format!("cannot write: {error}"));
                self.full = true;
            }
        }
    }

    /// The last line of a recording that ends too early, unless the file takes no more; as well as
    /// can be, for `close` returns the problem anyway.
    pub(crate) fn write_stopped(&mut self) {
        if let (Some(problem), Some(file), false) = (&self.problem, &mut self.file, self.full) {
            let mut line = String::new();
            string(key(&mut line, "stopped"), problem);
            let _ = writeln!(file, "{{{line}}}").and(file.flush());
        }
    }

    pub(crate) fn fail(&mut self, problem: &str) {
        if cfg!(feature = "off") {
            return;
        }
        let place = self
            .frame
            .map_or(String::new(), |number| format!("frame {number}: "));
        self.problem.get_or_insert(place + problem);
    }

    /// `in_frame`: whether the call belongs into a frame, or before all; `None`: both.
    pub(crate) fn may(&mut self, in_frame: Option<bool>) -> bool {
        if !self.open || in_frame.map_or(false, |belongs| belongs != self.frame.is_some()) {
            self.fail("a call out of place");
        }
        self.problem.is_none() && !cfg!(feature = "off")
    }

    pub(crate) fn view(&mut self, name: Option<&str>) -> &mut View {
        let named = |name: &str| View {
            name: name.to_string(),
            ..View::default()
        };
        let at = match name {
            None => 0,
            Some(name) => (1..self.views.len())
                .find(|&i| self.views[i].name == name)
                .unwrap_or_else(|| {
                    self.views.push(named(name));
                    self.views.len() - 1
                }),
        };
        &mut self.views[at]
    }

    pub(crate) fn part(&mut self, i: usize, name: &str, value: &str) {
        if self.may(Some(true)) {
            key(&mut self.parts[i], name).push_str(value);
        }
    }

    pub(crate) fn real<R: Real>(&mut self, value: R) -> String {
        if !value.is_real() {
            self.fail("a number is not finite");
        }
        format!("{value:?}")
    }

    pub(crate) fn matrix<R: Real>(&mut self, order: Order, m: &[R; 16]) -> String {
        let at = |i: usize| {
            if order == Order::RowMajor {
                i
            } else {
                i % 4 * 4 + i / 4
            }
        };
        let rows: [String; 4] = std::array::from_fn(|row| {
            let numbers: [String; 4] = std::array::from_fn(|i| self.real(m[at(4 * row + i)]));
            format!("[{}]", numbers.join(","))
        });
        format!("[{}]", rows.join(","))
    }
}
