// Writes what an engine saw and drew as a visref recording, one line per frame, for
// `visref check SCENE --recording FILE`. C# 6. In Unity, VisrefUnity.cs beside it takes a Camera as it is.
//
// Within a frame the calls come in any order, and from any thread; what is said before the first frame
// is said of all. What first goes wrong (a number that is not finite, a name that is no Unicode, a full
// disk, a call out of place) is kept, nothing is written after it but a last line that tells it, and Close throws
// it: rendering goes on undisturbed. `view` is null in a frame whose one view has no name. Cameras: README.md beside this file.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Text;

public sealed partial class VisrefRecorder : IDisposable
{
    public enum Form { WorldFromCamera, CameraFromWorld, ClipFromWorld }
    public enum Order { RowMajor, ColumnMajor }

    // A view of the frame; the first is the frame itself. Fields start with a comma each.
    private sealed class View
    {
        public string Name;
        public readonly StringBuilder Fields = new StringBuilder(), Visible = new StringBuilder(), Nodes = new StringBuilder();
        public bool HasCamera, HasVisible, HasNodes;
    }

    private const int Buffer = 1 << 16;
    private static readonly string[] Forms = { "world_from_camera", "camera_from_world", "clip_from_world" };
    private static readonly string[] Parts = { "groups", "world_from_object", "levels", "bounds", "stats", "ms" };
    private readonly object gate = new object();
    private readonly List<View> views = new List<View>();
    private readonly StringBuilder[] parts = new StringBuilder[Parts.Length];
    private readonly StringBuilder absent = new StringBuilder(), line = new StringBuilder();
    private StreamWriter writer;
    private int number = -1;
    private bool open = true, full; // full: the file takes no more

    public string Problem { get; private set; } // what first went wrong, or null
    public int Width { get; private set; } // pixels
    public int Height { get; private set; }

    public VisrefRecorder(string file, int width, int height)
    {
        Width = width;
        Height = height;
        for (int i = 0; i < parts.Length; i++) parts[i] = new StringBuilder();
        Start();
        views[0].Fields.Append(",\"width\":").Append(width).Append(",\"height\":").Append(height);
        try { writer = new StreamWriter(new FileStream(file, FileMode.Create), new UTF8Encoding(false), Buffer); }
        catch (Exception error) when (error is IOException || error is UnauthorizedAccessException)
        { Fail("cannot open the file: " + error.Message); }
    }

    /// `frame`: ascending; gaps are allowed.
    public void BeginFrame(int frame)
    {
        lock (gate)
        {
            if (number < 0) WriteHeader();
            else if (open) Fail("it has no end");
            if (frame <= number) Fail("the next must have a higher number");
            number = frame;
            open = true;
            Start();
        }
    }

    public void Time(double seconds) { Field("time_s", seconds); }

    /// The camera has jumped.
    public void Cut() { lock (gate) if (May(true)) views[0].Fields.Append(",\"cut\":true"); }

    public void Camera(Form form, Order order, double[] matrix, string view = null) { Camera(form, order, matrix, null, view); }
    public void Camera(Form form, Order order, float[] matrix, string view = null) { Camera(form, order, null, matrix, view); }
    private void Camera(Form form, Order order, double[] matrix, float[] single, string view)
    {
        lock (gate)
        {
            if (!May(true)) return;
            View of = ViewOf(view);
            if (of.HasCamera) Fail("a second camera");
            of.HasCamera = true;
            Key(of.Fields.Append(','), Forms[(int)form]);
            Matrix(of.Fields, order, matrix, single);
        }
    }

    /// "near", "far" (infinity: endless), "yfov" (vertical, radians) or "ymag" (half the view's height), "fps",
    /// "shift_x_px", "shift_y_px"; "width" and "height" of a view of another size.
    public void Field(string name, double value, string view = null)
    {
        lock (gate)
        {
            if (!May(null)) return;
            StringBuilder fields = ViewOf(view).Fields.Append(',');
            Key(fields, name);
            if (double.IsPositiveInfinity(value)) fields.Append("null"); else Number(fields, value);
        }
    }

    /// "units": a file of meshlets or batches, which Visible then lists. Of ClipFromWorld, "clip_depth": "-1..1"
    /// (OpenGL), "0..1", or "1..0" (reversed), and "clip_y": "down" (Vulkan).
    public void Text(string name, string text)
    {
        lock (gate) if (May(null)) { Key(views[0].Fields.Append(','), name); Name(views[0].Fields, text); }
    }

    /// Objects, by name or path, that the engine knows by one name.
    public void Group(string name, IEnumerable<string> objects)
    {
        lock (gate)
        {
            if (!May(false)) return;
            var names = new StringBuilder();
            foreach (string one in objects) Name(Comma(names), one);
            Part(0, name).Append('[').Append(names).Append(']');
        }
    }

    /// What is drawn, by id, by the name of an object or a group, or by glTF node index; no id at all says that nothing was.
    public void VisibleIds(IEnumerable<int> ids, string view = null) { lock (gate) if (May(true)) Whole(Set(view), ids); }
    public void VisibleName(string name, string view = null) { lock (gate) if (May(true)) Name(Comma(Set(view)), name); }
    public void VisibleNodes(IEnumerable<int> nodes, string view = null)
    {
        lock (gate) if (May(true)) { View of = ViewOf(view); of.HasNodes = true; Whole(of.Nodes, nodes); }
    }

    private StringBuilder Set(string view) { View of = ViewOf(view); of.HasVisible = true; return of.Visible; }
    private static void Whole(StringBuilder to, IEnumerable<int> all) { foreach (int one in all) Comma(to).Append(one); }

    public void Absent(string name) { lock (gate) if (May(true)) Name(Comma(absent), name); }

    /// `matrix`: world_from_object of an object, or what moves a whole group.
    public void Pose(string name, Order order, double[] matrix) { lock (gate) if (May(true)) Matrix(Part(1, name), order, matrix, null); }
    public void Pose(string name, Order order, float[] matrix) { lock (gate) if (May(true)) Matrix(Part(1, name), order, null, matrix); }

    public void Level(string group, int level) { lock (gate) if (May(true)) Part(2, group).Append(level); }

    /// The box that was tested, in world space.
    public void Bounds(string name, double[] least, double[] greatest)
    {
        lock (gate)
        {
            if (!May(true)) return;
            StringBuilder part = Part(3, name).Append("[[");
            for (int i = 0; i < 6; i++) Number(part, i < 3 ? least[i] : greatest[i - 3]).Append(i == 2 ? "],[" : i == 5 ? "]]" : ",");
        }
    }

    public void Stat(string name, long count) { lock (gate) if (May(true)) Part(4, name).Append(count); }
    public void StatMs(string phase, double ms) { lock (gate) if (May(true)) Number(Part(5, phase), ms); }

    public void EndFrame()
    {
        lock (gate)
        {
            if (!May(true)) return;
            open = false;
            line.Append("{\"frame\":").Append(number).Append(views[0].Fields);
            int given = 0; // a bit each: ids and names in one list, or by view; nodes, or nodes by view
            for (int i = 0; i < views.Count; i++)
            {
                View view = views[i];
                given |= ((view.HasVisible ? 1 : 0) + (view.HasNodes ? 4 : 0)) << (i > 0 ? 1 : 0);
                if ((i > 0 || views.Count == 1) && !view.HasCamera && !views[0].HasCamera) Fail("no camera");
                if (i == 0) continue;
                Key(line.Append(i > 1 ? "}," : ",\"views\":{"), view.Name);
                line.Append('{').Append(view.Fields.ToString().TrimStart(','));
            }
            if (views.Count > 1) line.Append("}}");
            if ((given & (given - 1)) != 0) Fail("what is visible is given in two ways");
            bool nodes = given > 2, joint = (given & 10) == 0;
            line.Append(nodes ? ",\"visible_nodes\":" : ",\"visible\":").Append(joint ? "" : "{");
            for (int i = joint ? 0 : 1; i < (joint ? 1 : views.Count); i++)
            {
                if (!joint) Key(i > 1 ? line.Append(',') : line, views[i].Name);
                line.Append('[').Append(nodes ? views[i].Nodes : views[i].Visible).Append(']');
            }
            line.Append(joint ? "" : "}");
            if (absent.Length > 0) line.Append(",\"absent\":[").Append(absent).Append(']');
            if (parts[5].Length > 0) Comma(parts[4]).Append("\"ms\":{").Append(parts[5]).Append('}');
            for (int i = 1; i < 5; i++) End(i);
            Write();
        }
    }

    /// What is written is not to be lost in a crash.
    public void Flush()
    {
        lock (gate)
            if (Problem == null && writer != null)
                try { writer.Flush(); } catch (IOException error) { Full(error); }
    }

    /// Throws InvalidDataException if anything went wrong.
    public void Close()
    {
        lock (gate)
        {
            if (number < 0) WriteHeader();
            else if (open) Fail("it has no end");
            line.Length = 0;
            if (Problem != null && !full) { Name(Key(line.Append('{'), "stopped"), Problem); Put(); }
            try { if (writer != null) writer.Dispose(); } catch (IOException error) { Full(error); }
            writer = null;
            if (Problem != null) throw new InvalidDataException(Problem);
        }
    }

    public void Dispose() { if (writer != null) Close(); }

    private void Start()
    {
        views.Clear();
        views.Add(new View());
        foreach (StringBuilder part in parts) part.Length = 0;
        absent.Length = line.Length = 0;
    }

    private void WriteHeader()
    {
        line.Append("{\"format\":\"visref-recording\",\"version\":1").Append(views[0].Fields);
        End(0);
        Write();
    }

    private void End(int i) { if (parts[i].Length > 0) Key(line.Append(','), Parts[i]).Append('{').Append(parts[i]).Append('}'); }

    private void Write() { if (Problem == null) Put(); }
    private void Put()
    {
        try { if (writer != null) writer.Write(line.Append("}\n").ToString()); } catch (IOException error) { Full(error); }
    }

    private void Full(IOException error) { full = true; Fail("cannot write: " + error.Message); }
    private void Fail(string problem) { if (Problem == null) Problem = (number < 0 ? "" : "frame " + number + ": ") + problem; }

    // `inFrame`: whether the call belongs into a frame, or before all; null: both.
    private bool May(bool? inFrame)
    {
        if (!open || (inFrame ?? number >= 0) != number >= 0) Fail("a call out of place");
        return Problem == null;
    }

    private View ViewOf(string name)
    {
        if (name == null) return views[0];
        for (int i = 1; i < views.Count; i++) if (views[i].Name == name) return views[i];
        views.Add(new View { Name = name });
        return views[views.Count - 1];
    }

    private static StringBuilder Comma(StringBuilder items) { return items.Length > 0 ? items.Append(',') : items; }
    private StringBuilder Part(int i, string name) { return Key(Comma(parts[i]), name); }
    private StringBuilder Key(StringBuilder to, string name) { Name(to, name); return to.Append(':'); }

    private void Name(StringBuilder to, string name)
    {
        to.Append('"');
        for (int i = 0; i < (name ?? "").Length; i++)
        {
            char c = name[i];
            if (c < ' ' || c == '"' || c == '\\') { to.Append("\\u").Append(((int)c).ToString("x4")); continue; }
            to.Append(c);
            if (!char.IsSurrogate(c)) continue;
            if (i + 1 < name.Length && char.IsSurrogatePair(c, name[i + 1])) to.Append(name[++i]);
            else Fail("a name is no Unicode: " + name);
        }
        if (name == null) Fail("a name is null");
        to.Append('"');
    }

    private StringBuilder Number(StringBuilder to, double value, string digits = "G17")
    {
        if (double.IsNaN(value) || double.IsInfinity(value)) Fail("a number is not finite");
        if (value != 0) return to.Append(value.ToString(digits, CultureInfo.InvariantCulture));
        return to.Append(BitConverter.DoubleToInt64Bits(value) < 0 ? "-0.0" : "0.0");
    }

    private void Matrix(StringBuilder to, Order order, double[] m, float[] f)
    {
        for (int i = 0; i < 16; i++)
        {
            int k = order == Order.RowMajor ? i : i % 4 * 4 + i / 4;
            to.Append(i == 0 ? "[[" : i % 4 == 0 ? "],[" : ",");
            if (m != null) Number(to, m[k]); else Number(to, f[k], "G9");
        }
        to.Append("]]");
    }

    /// CameraFromWorld, ColumnMajor, of a left-handed view matrix that looks down +Z (Direct3D's LookAtLH, Stride's
    /// and MonoGame's in memory), in a world that is the scene with one axis negated: 0 for x, 2 for z.
    public static double[] FromLeftHanded(double[] view, int negatedAxis)
    {
        var m = new double[16];
        for (int i = 0; i < 16; i++) m[i] = (i % 4 == 2) != (i / 4 == negatedAxis) ? -view[i] : view[i];
        return m;
    }
}
