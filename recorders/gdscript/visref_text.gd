class_name VisrefText
extends RefCounted
## What VisrefRecorder writes: strings and numbers of JSON, and a camera's numbers.

const BASE := 1000000000


## A camera's numbers in a recording. Its fov and its size are those of the side that keep_aspect
## keeps; its size is the whole of that side, in a frustum at the near plane.
static func camera_fields(camera: Camera3D, pixels: Vector2i) -> Dictionary:
	var by_width := 1.0
	if camera.keep_aspect == Camera3D.KEEP_WIDTH:
		by_width = float(pixels.y) / pixels.x
	if camera.projection == Camera3D.PROJECTION_PERSPECTIVE:
		return {"yfov": 2.0 * atan(tan(deg_to_rad(camera.fov) / 2.0) * by_width)}
	var half := camera.size / 2.0 * by_width
	if camera.projection == Camera3D.PROJECTION_ORTHOGONAL:
		return {"ymag": half}
	var per_unit := pixels.y / (2.0 * half)
	return {
		"yfov": 2.0 * atan(half / camera.near),
		"shift_x_px": camera.frustum_offset.x * per_unit,
		"shift_y_px": -camera.frustum_offset.y * per_unit,
	}


## The 16 numbers of a node's global_transform, row by row.
static func rows_of(t: Transform3D) -> Array:
	var b := t.basis
	return [
		b.x.x, b.y.x, b.z.x, t.origin.x,
		b.x.y, b.y.y, b.z.y, t.origin.y,
		b.x.z, b.y.z, b.z.z, t.origin.z,
		0.0, 0.0, 0.0, 1.0,
	]


## In bytes; Godot's files do not tell of a full disk.
static func size_of(path: String) -> int:
	var file := FileAccess.open(path, FileAccess.READ)
	return file.get_length() if file != null else 0


static func list(texts: Array) -> String:
	return "[" + ",".join(PackedStringArray(texts)) + "]"


## A JSON string; "" where half of a surrogate pair stands alone.
static func string(value: String) -> String:
	var text := "\""
	for i in value.length():
		var code := value.unicode_at(i)
		if code >= 0xD800 and code < 0xE000:
			return ""
		text += "\\u%04x" % code if code < 32 or code == 34 or code == 92 else value[i]
	return text + "\""


## A JSON string, with U+FFFD for what is no character.
static func lossy(value: String) -> String:
	var text := ""
	for i in value.length():
		text += value[i] if string(value[i]) != "" else char(0xFFFD)
	return string(text)


## A JSON number of at most 17 digits that reads back as the same number; "" where it is not finite.
## Godot's own printing may give too few digits, so this takes the number's bits: it is mantissa *
## 2^exponent, and 2^-n is 5^n / 10^n.
static func number(value: float) -> String:
	if is_nan(value) or is_inf(value):
		return ""
	var peer := StreamPeerBuffer.new()
	peer.put_double(value)
	peer.seek(0)
	var bits := peer.get_64()
	var minus := "-" if bits < 0 else ""
	var exponent := (bits >> 52) & 0x7FF
	var mantissa := bits & 0xFFFFFFFFFFFFF
	if exponent > 0:
		mantissa |= 1 << 52
	if mantissa == 0:
		return minus + "0.0"
	exponent = maxi(exponent, 1) - 1075
	while exponent < 0 and mantissa % 2 == 0:
		mantissa >>= 1
		exponent += 1
	var limbs := [mantissa % BASE, mantissa / BASE]
	for _chunk in absi(exponent) / 9:
		_multiply(limbs, 512 if exponent > 0 else 1953125)
	for _rest in absi(exponent) % 9:
		_multiply(limbs, 2 if exponent > 0 else 5)
	var digits := ""
	for limb in limbs:
		digits = "%09d" % limb + digits
	digits = digits.lstrip("0")
	var tens := mini(exponent, 0)
	if digits.length() > 17:
		tens += digits.length() - 17
		# Rounded: the nearest of 17 digits is nearer to this number than to any other.
		var up := 1 if digits.unicode_at(17) >= 53 else 0
		digits = str(int(digits.substr(0, 17)) + up)
	return minus + digits + ("e%d" % tens if tens != 0 else ".0")


## `limbs`: nine decimal digits each, the lowest first.
static func _multiply(limbs: Array, factor: int) -> void:
	var carry := 0
	for i in limbs.size():
		carry += limbs[i] * factor
		limbs[i] = carry % BASE
		carry /= BASE
	if carry > 0:
		limbs.append(carry)
