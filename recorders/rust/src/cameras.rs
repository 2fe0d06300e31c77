//! Cameras of engines whose axes are not glTF's.

/// The vertical field of view of a horizontal one, in radians; square pixels.
pub fn yfov_from_xfov(xfov: f64, width: u32, height: u32) -> f64 {
    2.0 * ((xfov / 2.0).tan() * f64::from(height) / f64::from(width)).atan()
}

/// `CameraFromWorld`, `ColumnMajor`, of a left-handed view matrix that looks down +Z (glam's
/// `look_at_lh`), in a world that is the scene with one axis negated: 0 for x, 2 for z.
pub fn from_left_handed(view: &[f64; 16], negated_axis: usize) -> [f64; 16] {
    flipped(view, |row, column| (row == 2) != (column == negated_axis))
}

/// `CameraFromWorld`, `ColumnMajor`, of a right-handed view matrix with +Y down that looks down +Z
/// (OpenCV, some Vulkan engines).
pub fn from_y_down(view: &[f64; 16]) -> [f64; 16] {
    flipped(view, |row, _| row == 1 || row == 2)
}

fn flipped(view: &[f64; 16], negative: impl Fn(usize, usize) -> bool) -> [f64; 16] {
    std::array::from_fn(|i| {
        if negative(i % 4, i / 4) {
            -view[i]
        } else {
            view[i]
        }
    })
}
