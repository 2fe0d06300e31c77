class_name VisrefRecorder
extends RefCounted
## Writes what an engine saw and drew as a visref recording, one line per frame, for
## `visref check SCENE --recording FILE`. Godot 4; copy this file and visref_text.gd in.
##
## Within a frame the calls come in any order; what is said before all frames is said of all. What
## first goes wrong (a number that is not finite, a full disk, a call out of place) is kept, nothing
## but a last line that tells it is written after it, and close() returns it. `view` may be "".

const FORMS := ["world_from_camera", "camera_from_world", "clip_from_world"]

## What went wrong first; "" if nothing did.
var problem := ""

var _file: FileAccess
var _path := ""
var _written := 0
var _number := -1
var _open := true
var _size := Vector2i.ZERO
# JSON's texts by member, of the frame and of each view in it.
var _frame := {}
var _views := {}
var _sets := {}
var _parts := {}
var _absent := []


## Sizes are in pixels.
func _init(path: String, width: int, height: int) -> void:
	_path = path
	_size = Vector2i(width, height)
	var format := "\"visref-recording\""
	_start({"format": format, "version": "1", "width": str(width), "height": str(height)})
	_file = FileAccess.open(path, FileAccess.WRITE)
	if _file == null:
		_fail("cannot open the file: error %d" % FileAccess.get_open_error())


## `number`: ascending; gaps are allowed.
func begin_frame(number: int) -> void:
	if _number < 0:
		_write()
	elif _open:
		_fail("it has no end")
	if number <= _number:
		_fail("the next must have a higher number")
	_number = number
	_open = true
	_start({"frame": str(number)})


func time(seconds: float) -> void:
	field("time_s", seconds)


## The camera has jumped.
func cut() -> void:
	if _may(1):
		_frame["cut"] = "true"


## `form`: one of FORMS. `matrix`: 16 numbers, row by row.
func camera(form: String, matrix: Array, view := "") -> void:
	if not _may(1):
		return
	var fields := _view(view)
	if _has_camera(fields) or not form in FORMS:
		_fail("a second camera" if form in FORMS else "a camera cannot be a " + form)
	fields[form] = _matrix(matrix)


## A Camera3D as it is: pose, near, far, field of view or size, frustum offset. Godot's axes and
## units are glTF's.
func camera_3d(from: Camera3D, view := "") -> void:
	camera("world_from_camera", VisrefText.rows_of(from.get_camera_transform()), view)
	field("near", from.near, view)
	field("far", from.far, view)
	var fields := VisrefText.camera_fields(from, _size)
	for name in fields:
		field(name, fields[name], view)


## "near", "far" (INF: endless), "yfov" (vertical, radians) or "ymag" (half the view's height),
## "fps", "shift_x_px", "shift_y_px"; "width" and "height" of a view of another size.
func field(name: String, value: float, view := "") -> void:
	if _may(0):
		var text := "null" if value == INF else _real(value)
		_view(view)[name] = str(int(value)) if name in ["width", "height"] else text


## "units": a file of meshlets or batches, which `visible` then lists.
func text(name: String, value: String) -> void:
	if _may(0):
		_frame[name] = _name(value)


## Objects, by name or path, that the engine knows by one name.
func group(name: String, objects: Array) -> void:
	if _may(-1):
		_part("groups", name, VisrefText.list(objects.map(_name)))


## Ids and names, of objects or groups; [] says that nothing was drawn.
func visible(drawn: Array, view := "") -> void:
	if _may(1):
		var to := _set_of("visible", view)
		for one in drawn:
			var named: bool = one is String or one is StringName
			to.append(_name(str(one)) if named else _whole(one, "visible", "ids"))


## The same by glTF node index.
func visible_nodes(nodes: Array, view := "") -> void:
	if _may(1):
		var to := _set_of("visible_nodes", view)
		for node in nodes:
			to.append(_whole(node, "visible_nodes", "node indices"))


func absent(name: String) -> void:
	if _may(1):
		_absent.append(_name(name))


## `matrix`: world_from_object of an object (VisrefText.rows_of its global_transform), or what moves
## a whole group.
func pose(name: String, matrix: Array) -> void:
	if _may(1):
		_part("world_from_object", name, _matrix(matrix))


func level(group_name: String, number: int) -> void:
	if _may(1):
		_part("levels", group_name, _whole(number, "level", "levels"))


## The box that was tested, in world space: three numbers each.
func bounds(name: String, least: Array, greatest: Array) -> void:
	if _may(1):
		var corners := [VisrefText.list(least.map(_real)), VisrefText.list(greatest.map(_real))]
		_part("bounds", name, VisrefText.list(corners))


func stat(name: String, count: int) -> void:
	if _may(1):
		_part("stats", name, _whole(count, "stat", "counts"))


func stat_ms(phase: String, ms: float) -> void:
	if _may(1):
		_part("ms", phase, _real(ms))


func end_frame() -> void:
	if not _may(1):
		return
	_open = false
	for fields in [_frame] if _views.is_empty() else _views.values():
		if not _has_camera(fields) and not _has_camera(_frame):
			_fail("no camera")
	var nodes: bool = not _sets["visible_nodes"].is_empty()
	var sets: Dictionary = _sets["visible_nodes" if nodes else "visible"]
	var joint := sets.is_empty() or sets.has("")
	if (nodes and not _sets["visible"].is_empty()) or (joint and sets.size() > 1):
		_fail("what is visible is given in two ways")
	var by_view := {}
	for view in _views:
		by_view[view] = VisrefText.list(sets.get(view, []))
	var drawn := VisrefText.list(sets.get("", [])) if joint else _object(by_view)
	_frame["visible_nodes" if nodes else "visible"] = drawn
	_write()


## What is written is not to be lost in a crash.
func flush() -> void:
	if _file != null:
		_file.flush()


## What went wrong first; "" if nothing did.
func close() -> String:
	if _number < 0:
		_write()
	elif _open:
		_fail("it has no end")
	flush()
	if VisrefText.size_of(_path) != _written:
		_fail("cannot write: the file has less than %d bytes" % _written)
	elif problem != "" and _file != null:
		_file.store_string("{\"stopped\":" + VisrefText.lossy(problem) + "}\n")
		flush()
	_file = null
	if problem != "":
		push_error("VisrefRecorder: " + problem)
	return problem


func _start(frame: Dictionary) -> void:
	_frame = frame
	_views = {}
	_sets = {"visible": {}, "visible_nodes": {}}
	_parts = {}
	_absent = []


func _write() -> void:
	var views := {}
	for view in _views:
		views[view] = _object(_views[view])
	if not views.is_empty():
		_frame["views"] = _object(views)
	if not _absent.is_empty():
		_frame["absent"] = VisrefText.list(_absent)
	if _parts.has("ms"):
		_part("stats", "ms", _object(_parts["ms"]))
		_parts.erase("ms")
	for part in _parts:
		_frame[part] = _object(_parts[part])
	var line := _object(_frame) + "\n"
	if problem == "" and _file != null:
		_file.store_string(line)
		_written += line.to_utf8_buffer().size()


func _fail(what: String) -> void:
	if problem == "":
		problem = what if _number < 0 else "frame %d: %s" % [_number, what]


## `place`: 1 for a call that belongs into a frame, -1 for one before all frames, 0 for both.
func _may(place: int) -> bool:
	if not _open or (place != 0 and (place > 0) != (_number >= 0)):
		_fail("a call out of place")
	return problem == ""


func _view(view: String) -> Dictionary:
	if view == "":
		return _frame
	if not _views.has(view):
		_views[view] = {}
	return _views[view]


func _has_camera(fields: Dictionary) -> bool:
	return fields.has(FORMS[0]) or fields.has(FORMS[1]) or fields.has(FORMS[2])


func _set_of(key: String, view: String) -> Array:
	_view(view)
	if not _sets[key].has(view):
		_sets[key][view] = []
	return _sets[key][view]


func _part(part: String, name: String, value: String) -> void:
	if not _parts.has(part):
		_parts[part] = {}
	_parts[part][name] = value


func _object(members: Dictionary) -> String:
	var texts := []
	for name in members:
		texts.append(_name(name) + ":" + members[name])
	return "{" + ",".join(PackedStringArray(texts)) + "}"


func _name(name: String) -> String:
	var text := VisrefText.string(name)
	if text == "":
		_fail("a name is no Unicode")
	return text


func _real(value: float) -> String:
	var text := VisrefText.number(value)
	if text == "":
		_fail("a number is not finite")
	return text


func _whole(value, call_name: String, what: String) -> String:
	if not (value is int or value is float) or value < 0 or value != int(value):
		_fail("%s got %s; %s are whole numbers" % [call_name, value, what])
		return "0"
	return str(int(value))


func _matrix(matrix: Array) -> String:
	if matrix.size() != 16:
		_fail("a matrix has 16 numbers")
		return "[]"
	var m := matrix.map(_real)
	var rows := []
	for i in [0, 4, 8, 12]:
		rows.append(VisrefText.list([m[i], m[i + 1], m[i + 2], m[i + 3]]))
	return VisrefText.list(rows)
