# Prints what a scene that was imported has: its animations, and where bones are at some times of each.
extends SceneTree


func _initialize():
	var times = OS.get_environment("TIMES").split_floats(" ")
	var scene = load("res://" + OS.get_environment("SCENE"))
	var shown = scene.instance()
	get_root().add_child(shown)
	var player = found(shown, "AnimationPlayer")
	var skeleton = found(shown, "Skeleton")
	for animation in player.get_animation_list():
		print("ANIMATION\t", animation, "\t", player.get_animation(animation).length)
		for moment in times.size():
			player.play(animation)
			player.seek(times[moment], true)
			for bone in skeleton.get_bone_count():
				var place = (skeleton.global_transform * skeleton.get_bone_global_pose(bone)).origin
				print(PoolStringArray(["BONE", animation, moment, skeleton.get_bone_name(bone), place.x, place.y, place.z]).join("\t"))
	quit()


func found(node, kind):
	if node.get_class() == kind:
		return node
	for child in node.get_children():
		var inside = found(child, kind)
		if inside:
			return inside
	return null
