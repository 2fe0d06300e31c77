// What VisrefRecorder takes from Unity as it is: cameras, and objects' matrices. The scene's glTF importer has negated
// x, as those for Unity do. Unity is left-handed; its view and projection matrices are of OpenGL's kind.
using System;
using UnityEngine;

public sealed partial class VisrefRecorder
{
    public void Camera(Camera camera, string view = null)
    {
        Matrix4x4 seen = camera.worldToCameraMatrix, p = camera.projectionMatrix;
        var m = new float[16];
        for (int i = 0; i < 16; i++) m[i] = i < 4 ? -seen[i] : seen[i];
        Camera(Form.CameraFromWorld, Order.ColumnMajor, m, view);
        Field("near", camera.nearClipPlane, view);
        Field("far", camera.farClipPlane, view);
        bool flat = camera.orthographic;
        if (flat) Field("ymag", 1.0 / p[1, 1], view); else Field("yfov", 2 * Math.Atan(1.0 / p[1, 1]), view);
        // An off-centre frustum, as of a lens shift or of temporal antialiasing.
        double x = flat ? -p[0, 3] : p[0, 2], y = flat ? -p[1, 3] : p[1, 2];
        if (x != 0) Field("shift_x_px", x * Width / 2, view);
        if (y != 0) Field("shift_y_px", -y * Height / 2, view);
    }

    /// `localToWorld`: a transform's localToWorldMatrix.
    public void Pose(string name, Matrix4x4 localToWorld)
    {
        var m = new float[16];
        for (int i = 0; i < 16; i++) m[i] = (i < 4) != (i % 4 == 0) ? -localToWorld[i] : localToWorld[i];
        Pose(name, Order.ColumnMajor, m);
    }
}
