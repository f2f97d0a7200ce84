"""Decisions on each property of Blender that could change a picture. A test walks the properties of the running
Blender and asks for a decision on each.

By structure: by what becomes of them, names of properties, which may end in `*`. READ: they are exported. NAMED: what
they ask for is not in the picture, and a warning says so. REFUSED: an error says so. IN_F12: as it says. Any other key
is a reason why they change no picture of Relume.
"""

from fnmatch import fnmatchcase

READ, NAMED, REFUSED = "read", "named", "refused"
VIEWS = "only for views and editors"
NOISE = "changes noise and speed, not what the picture converges to"
OUTPUT = "of the picture's file, or of passes that Relume does not write"
EEVEE = "of EEEVEE, Workbench or viewports"
BAKED = "of baking to textures"
BY_DEPSGRAPH = "done by Blender before the scene is read"
HAIR = "of hair"
"""Not supported: each object or scene that has it is named."""
MARCHING = "of Cycles' steps through media, of which Relume has none"
CAUSTICS = "of shadow caustics, which each light that asks for them names"
IN_F12 = "approximated: Blender adds it to F12 with Relume; live pictures and bakes are without it, which is named"
SAME = "another unit or name of a property that is read"
FAST_GI = (
    "approximated: large lamps beyond its distance are brighter, and scenes with volumes are without; both are named"
)
STAMP = "words burnt into the picture's file"

LIGHT = {
    READ: "color node_tree use_nodes cycles use_temperature temperature exposure normalize energy type use_shadow",
    EEVEE: "specular_factor diffuse_factor transmission_factor volume_factor use_custom_distance cutoff_distance "
    "shadow_buffer* shadow_color use_contact_shadow contact_shadow* shadow_filter_radius shadow_maximum_resolution "
    "use_shadow_jitter shadow_jitter_overblur use_absolute_resolution shadow_cascade*",
    BY_DEPSGRAPH: "animation_data",
    READ + " where the type of light has it": "shadow_soft_size use_soft_falloff spot_blend spot_size use_square shape "
    "size size_y spread angle",
    VIEWS: "show_cone",
}

TABLE = {
    "RenderSettings": {
        READ: "resolution_* pixel_aspect_* film_transparent border_* use_single_layer use_motion_blur motion_blur_*",
        IN_F12: "use_border use_freestyle use_compositing use_sequencer",
        READ + " by what it limits": "use_simplify",
        REFUSED: "use_multiview",
        READ + " in F12, where Blender crops": "use_crop_to_border",
        OUTPUT: "image_settings ffmpeg dither_intensity filter_size use_placeholder use_overwrite use_file_extension "
        "filepath use_render_cache views stereo_views views_format save_output ppm_factor ppm_base",
        BAKED: "bake bake_* use_bake_*",
        STAMP: "use_stamp* stamp_* metadata_input",
        HAIR: "hair_type hair_subdiv",
        BY_DEPSGRAPH: "fps fps_base frame_map_* simplify_subdivision* simplify_child_particles* simplify_gpencil* "
        "simplify_volumes",
        VIEWS: "preview_pixel_size use_lock_interface sequencer_gl_preview use_sequencer_override_scene_strip "
        "use_simplify_normals use_high_quality_normals",
        NOISE: "threads threads_mode use_persistent_data",
        "the scene is read whatever its engine": "engine",
        "Freestyle's": "line_thickness*",
        "the compositor's": "compositor_* use_compositor_frames_cache",
        EEVEE: "anisotropic_filter",
        "of Cycles' memory": "use_texture_cache use_auto_generate_texture_cache",
    },
    "CyclesRenderSettings": {
        READ: "samples max_bounces *_bounces min_* transparent_max_bounces caustics_* blur_glossy film_exposure "
        "pixel_filter_type filter_width film_transparent_* seed diffuse_bounces glossy_bounces transmission_bounces "
        "fast_gi_method ao_bounces_render "
        "rolling_shutter_* use_camera_cull use_distance_cull camera_cull_margin distance_cull_margin dicing_* "
        "max_subdivisions offscreen_*",
        READ + " for adaptive subdivision": "feature_set",
        FAST_GI: "use_fast_gi",
        NAMED: "sample_clamp_*",
        READ + " with Simplify": "texture_limit_render texture_resolution_render",
        "of nodes with scripts, which are named": "shading_system",
        NOISE: "device sampling_pattern *scrambling_distance use_layer_samples light_sampling_threshold "
        "use_adaptive_sampling adaptive_* direct_light_sampling_type use_light_tree use_guiding* "
        "use_deterministic_guiding guiding_* use_surface_guiding surface_guiding_* use_volume_guiding volume_guiding_* "
        "use_animated_seed sample_offset time_limit use_auto_tile tile_size use_sample_subset sample_subset_length "
        "use_pixel_jitter",
        "Relume has its own denoiser": "use_denoising denoiser denoising_*",
        VIEWS: "preview_* use_preview_* texture_limit texture_resolution ao_bounces",
        MARCHING: "volume_*",
        BAKED: "bake_type",
        "for who develops Cycles": "debug_*",
    },
    "ViewLayer": {
        READ: "material_override world_override use_sky use_solid layer_collection objects use cycles",
        READ + ": without it nothing of its kind is named": "use_strand use_volumes use_motion_blur use_grease_pencil",
        NOISE: "samples",
        "Cycles does not read it": "use_ao",
        EEVEE: "eevee",
        IN_F12: "use_freestyle freestyle_settings",
        OUTPUT: "name pass_alpha_threshold aovs active_aov* lightgroups active_lightgroup* use_pass_* "
        "pass_cryptomatte_depth",
        VIEWS: "active_layer_collection depsgraph",
    },
    "CyclesRenderLayerSettings": {
        READ: "use_pass_shadow_catcher",
        OUTPUT: "pass_* use_pass_* denoising_*",
        "Relume has its own denoiser": "use_denoising",
    },
    "LayerCollection": {
        READ: "collection children indirect_only holdout",
        BY_DEPSGRAPH: "exclude",
        VIEWS: "hide_viewport",
    },
    "Object": {
        READ: "data matrix_world material_slots pass_index color visible_camera visible_diffuse visible_glossy "
        "visible_transmission visible_volume_scatter visible_shadow visible_raycast light_linking cycles "
        "is_holdout is_shadow_catcher modifiers particle_systems",
        "exported, or named by who exports the shading offset": "shadow_terminator_*",
        BY_DEPSGRAPH: "parent* use_camera_lock_parent track_axis up_axis location rotation_* scale dimensions delta_* "
        "lock_* matrix_local matrix_basis matrix_parent_inverse grease_pencil_modifiers constraints vertex_groups "
        "add_rest_position_attribute field collision soft_body rigid_body* use_simulation_cache hide_render "
        "show_instancer_for_render instance_* use_instance_* pose show_only_shape_key active_shape_key* animation_data "
        "use_parent_final_indices",
        VIEWS: "active_material* shader_effects empty_* image_user show_empty_* use_empty_image_alpha hide_viewport "
        "hide_select show_instancer_for_viewport display* show_* use_shape_key_edit_mode lineart use_mesh_mirror_* "
        "animation_visualization motion_path selection_sets active_selection_set hide_surface_pick "
        "use_grease_pencil_lights",
        EEVEE: "hide_probe_*",
        OUTPUT: "lightgroup",
    },
    "CyclesObjectSettings": {
        READ: "use_motion_blur use_deform_motion motion_steps use_camera_cull use_distance_cull "
        "use_adaptive_subdivision dicing_rate ao_distance",
        "exported, or named by who exports the shading offset": "shadow_terminator_*",
        CAUSTICS: "is_caustics_*",
    },
    "ObjectLightLinking": {READ: "receiver_collection blocker_collection"},
    "PointLight": LIGHT,
    "SpotLight": LIGHT,
    "AreaLight": LIGHT,
    "SunLight": LIGHT,
    "CyclesLightSettings": {READ: "is_portal max_bounces use_multiple_importance_sampling", NAMED: "is_caustics_light"},
    "Volume": {
        READ: "filepath packed_file grids is_sequence frame_* sequence_mode render materials velocity_*",
        BY_DEPSGRAPH: "animation_data",
        VIEWS: "display",
    },
    "VolumeRender": {
        READ: "clipping space",
        MARCHING: "step_size",
        "of Cycles' memory: ours are whole floats": "precision",
    },
    "World": {
        READ: "color node_tree use_nodes cycles cycles_visibility light_settings",
        EEVEE: "use_eevee_finite_volume probe_resolution sun_* use_sun_*",
        OUTPUT: "mist_settings lightgroup",
        BY_DEPSGRAPH: "animation_data",
    },
    "CyclesWorldSettings": {
        NAMED: "max_bounces use_shadows",
        CAUSTICS: "is_caustics_light",
        NOISE: "sampling_method sample_map_resolution",
        MARCHING: "homogeneous_volume volume_*",
    },
    "CyclesVisibilitySettings": {READ: "camera diffuse glossy transmission scatter", NOISE: "shadow"},
    "WorldLighting": {READ: "ao_factor distance"},
    "Material": {
        READ: "node_tree use_nodes diffuse_color pass_index cycles use_transparent_shadow displacement_method",
        EEVEE: "surface_render_method blend_method shadow_method alpha_threshold use_transparency_overlap "
        "show_transparent_back use_backface_culling* use_raytrace_refraction use_screen_refraction "
        "use_sss_translucency refraction_depth thickness_mode use_thickness_from_shadow volume_intersection_method "
        "specular_color roughness specular_intensity metallic max_vertex_displacement",
        BY_DEPSGRAPH: "animation_data",
        VIEWS: "preview_render_type use_preview_world texture_paint_* paint_* line_color line_priority lineart",
        IN_F12: "grease_pencil",
    },
    "CyclesMaterialSettings": {
        READ: "emission_sampling use_bump_map_correction",
        MARCHING: "homogeneous_volume volume_*",
    },
    "Camera": {
        READ: "sensor_fit clip_* lens sensor_width sensor_height ortho_scale shift_* dof type panorama_type fisheye_* "
        "latitude_* longitude_* central_cylindrical_*",
        SAME: "angle angle_x angle_y lens_unit",
        "of custom and stereo cameras, which are refused": "custom_* cycles_custom stereo",
        VIEWS: "passepartout_alpha display_size show_* background_images composition_guide_color",
        BY_DEPSGRAPH: "animation_data",
    },
    "CameraDOFSettings": {
        READ: "use_dof focus_* aperture_*",
    },
    "Image": {
        READ: "filepath filepath_raw source packed_file packed_files generated_* use_generated_float pixels "
        "colorspace_settings alpha_mode use_view_as_render tiles",
        VIEWS: "display_aspect render_slots resolution seam_margin",
        OUTPUT: "file_format views_format",
        "of movies and stereo pictures": "use_deinterlace use_multiview stereo_3d_format",
        "of Cycles' memory": "use_half_precision",
    },
    "ImageUser": {
        READ: "frame_* use_cyclic tile",
        VIEWS: "use_auto_refresh",
    },
    "MaterialSlot": {READ: "link material"},
    "ParticleSettings": {READ: "type render_type count", BY_DEPSGRAPH: "*"},
    "UnitSettings": {VIEWS: "*"},
    "Scene": {
        READ: "camera background_set world objects view_settings display_settings view_layers collection cycles render",
        IN_F12: "sequence_editor node_tree use_nodes compositing_node_group compositor_effects grease_pencil_settings",
        BY_DEPSGRAPH: "frame_* animation_data simulation_* use_custom_simulation_range rigidbody_world gravity "
        "use_gravity",
        HAIR: "cycles_curves",
        EEVEE: "eevee display hydra",
        VIEWS: "lock_frame_selection_to_range use_preview_range show_* sync_mode keying_sets* tool_settings "
        "unit_settings safe_areas timeline_markers transform_orientation_slots cursor grease_pencil annotation "
        "active_clip time_jump_* allow_preroll playback_loop_mode wrap_timeline_navigation",
        "sound": "use_audio* audio_*",
        STAMP: "use_stamp_note",
        "the sequencer's": "sequencer_colorspace_settings",
    },
}


def decision_on(structure, prop):
    """Decision about a property of a structure; None if nobody has decided. A whole name goes before a pattern."""
    by_name = {pattern: fate for fate, patterns in TABLE[structure].items() for pattern in patterns.split()}
    matching = (fate for pattern, fate in by_name.items() if fnmatchcase(prop, pattern))
    return by_name.get(prop) or next(matching, None)
