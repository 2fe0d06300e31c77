//! Writes what an engine saw and drew as a visref recording, one line per frame, for
//! `visref check SCENE --recording FILE`. No dependencies; the feature `off` makes every call nothing.
//!
//! Within a frame the calls come in any order; what is said before the first frame is said of all.
//! What first goes wrong (a number that is not finite, a full disk, a call out of place) is kept,
//! nothing is written after it but a last line that tells it, and `close` returns it: no other call
//! needs a check. `view` is `None` in a frame whose one view has no name. Several threads share a
//! `Mutex<Recorder>`. Cameras: README.md.
#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod cameras;
mod json;
mod lines;

pub use cameras::{from_left_handed, from_y_down, yfov_from_xfov};
use json::{comma, key, string, whole};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

/// What a camera's matrix is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// The camera's pose: it looks down its own -Z, with +Y up.
    WorldFromCamera,
    /// The view matrix.
    CameraFromWorld,
    /// Projection times view.
    ClipFromWorld,
}

/// How 16 numbers make a matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Row by row.
    RowMajor,
    /// Column by column, as glam, nalgebra and cgmath store it.
    ColumnMajor,
}

/// `f32` or `f64`, written with the fewest digits that read back as the same number.
pub trait Real: Copy + std::fmt::Debug {
    /// Neither infinite nor no number.
    fn is_real(self) -> bool;
}
impl Real for f32 {
    fn is_real(self) -> bool {
        self.is_finite()
    }
}
impl Real for f64 {
    fn is_real(self) -> bool {
        self.is_finite()
    }
}

/// A view of the frame; the first is the frame itself. Its texts are joined by commas.
#[derive(Default)]
struct View {
    name: String,
    fields: String,
    has_camera: bool,
    visible: Option<String>,
    nodes: Option<String>,
}

const BUFFER: usize = 1 << 16;
const PARTS: [&str; 6] = [
    "groups",
    "world_from_object",
    "levels",
    "bounds",
    "stats",
    "ms",
];

/// A recording that is being written.
pub struct Recorder {
    file: Option<BufWriter<File>>,
    problem: Option<String>,
    full: bool,
    frame: Option<u32>,
    open: bool,
    views: Vec<View>,
    parts: [String; 6],
    absent: String,
}

impl Recorder {
    /// A new recording. Sizes are in pixels.
    pub fn create(path: impl AsRef<Path>, width: u32, height: u32) -> Recorder {
        let mut recorder = Recorder {
            file: None,
            problem: None,
            full: false,
            frame: None,
            open: true,
            views: vec![View::default()],
            parts: Default::default(),
            absent: String::new(),
        };
        recorder.views[0].fields = format!("\"width\":{width},\"height\":{height}");
        if !cfg!(feature = "off") {
            match File::create(path) {
                Ok(file) => recorder.file = Some(BufWriter::with_capacity(BUFFER, file)),
                Err(error) => recorder.fail(&format!("cannot open the file: {error}")),
            }
        }
        recorder
    }

    /// Frames are ascending; gaps are allowed.
    pub fn begin_frame(&mut self, number: u32) {
        if cfg!(feature = "off") {
            return;
        }
        match self.frame {
            None => self.write_header(),
            Some(_) if self.open => self.fail("it has no end"),
            Some(before) if number <= before => self.fail("the next must have a higher number"),
            _ => {}
        }
        self.frame = Some(number);
        self.open = true;
        self.views.clear();
        self.views.push(View::default());
        self.parts.iter_mut().for_each(String::clear);
        self.absent.clear();
    }

    /// The moment, in seconds.
    pub fn time(&mut self, seconds: f64) {
        self.field("time_s", seconds, None);
    }

    /// The camera has jumped.
    pub fn cut(&mut self) {
        if self.may(Some(true)) {
            comma(&mut self.views[0].fields).push_str("\"cut\":true");
        }
    }

    /// The camera of a view.
    pub fn camera<R: Real>(&mut self, form: Form, order: Order, m: &[R; 16], view: Option<&str>) {
        if !self.may(Some(true)) {
            return;
        }
        let name = match form {
            Form::WorldFromCamera => "world_from_camera",
            Form::CameraFromWorld => "camera_from_world",
            Form::ClipFromWorld => "clip_from_world",
        };
        let matrix = self.matrix(order, m);
        let of = self.view(view);
        let again = std::mem::replace(&mut of.has_camera, true);
        key(&mut of.fields, name).push_str(&matrix);
        if again {
            self.fail("a second camera");
        }
    }

    /// "near", "far" (infinite: endless), "yfov" (vertical, radians) or "ymag" (half the view's
    /// height), "fps", "shift_x_px", "shift_y_px"; "width" and "height" of a view of another size.
    pub fn field(&mut self, name: &str, value: f64, view: Option<&str>) {
        if self.may(None) {
            let text = match name {
                "width" | "height" => format!("{}", value as i64),
                _ if value == f64::INFINITY => "null".to_string(),
                _ => self.real(value),
            };
            key(&mut self.view(view).fields, name).push_str(&text);
        }
    }

    /// "units": a file of meshlets or batches, which `visible` then lists. Of `ClipFromWorld`,
    /// "clip_depth": "-1..1" (OpenGL), "0..1" or "1..0" (reversed), and "clip_y": "down" (Vulkan).
    pub fn text(&mut self, name: &str, text: &str) {
        if self.may(None) {
            string(key(&mut self.views[0].fields, name), text);
        }
    }

    /// Objects, by name or path, that the engine knows by one name.
    pub fn group(&mut self, name: &str, objects: &[&str]) {
        if self.may(Some(false)) {
            let mut names = String::new();
            objects
                .iter()
                .for_each(|one| string(comma(&mut names), one));
            let _ = write!(key(&mut self.parts[0], name), "[{names}]");
        }
    }

    /// What is drawn, by id; `&[]` says that nothing was.
    pub fn visible_ids(&mut self, ids: &[u32], view: Option<&str>) {
        if self.may(Some(true)) {
            whole(self.view(view).visible.get_or_insert_with(String::new), ids);
        }
    }

    /// What is drawn, by the name of an object or a group.
    pub fn visible_name(&mut self, name: &str, view: Option<&str>) {
        if self.may(Some(true)) {
            string(
                comma(self.view(view).visible.get_or_insert_with(String::new)),
                name,
            );
        }
    }

    /// What is drawn, by glTF node index.
    pub fn visible_nodes(&mut self, nodes: &[u32], view: Option<&str>) {
        if self.may(Some(true)) {
            whole(self.view(view).nodes.get_or_insert_with(String::new), nodes);
        }
    }

    /// An object that does not exist in this frame.
    pub fn absent(&mut self, name: &str) {
        if self.may(Some(true)) {
            string(comma(&mut self.absent), name);
        }
    }

    /// world_from_object of an object, or what moves a whole group.
    pub fn pose<R: Real>(&mut self, name: &str, order: Order, m: &[R; 16]) {
        if self.may(Some(true)) {
            let matrix = self.matrix(order, m);
            self.part(1, name, &matrix);
        }
    }

    /// Which level of detail of a group is there.
    pub fn level(&mut self, group: &str, level: u32) {
        self.part(2, group, &level.to_string());
    }

    /// The box that was tested, in world space.
    pub fn bounds<R: Real>(&mut self, name: &str, least: &[R; 3], greatest: &[R; 3]) {
        let corner = |recorder: &mut Self, p: &[R; 3]| p.map(|one| recorder.real(one)).join(",");
        let text = format!("[[{}],[{}]]", corner(self, least), corner(self, greatest));
        self.part(3, name, &text);
    }

    /// A count, such as "queries".
    pub fn stat(&mut self, name: &str, count: u64) {
        self.part(4, name, &count.to_string());
    }

    /// Milliseconds of a phase.
    pub fn stat_ms(&mut self, phase: &str, ms: f64) {
        let text = self.real(ms);
        self.part(5, phase, &text);
    }

    /// What is written is not to be lost in a crash.
    pub fn flush(&mut self) {
        if let (None, Some(file)) = (&self.problem, &mut self.file) {
            if let Err(error) = file.flush() {
                self.fail(&format!("cannot write: {error}"));
                self.full = true;
            }
        }
    }

    /// What first went wrong, if anything did.
    pub fn close(mut self) -> Result<(), String> {
        match self.frame {
            None => self.write_header(),
            Some(_) if self.open => self.fail("it has no end"),
            _ => {}
        }
        self.flush();
        self.write_stopped();
        self.problem.map_or(Ok(()), Err)
    }
}
