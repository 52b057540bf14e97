#version 300 es
// One Gaussian as the box in which it is seen: projected as DeGense's own rasterizer does (EWA splatting).
precision highp float;
precision highp sampler2D;

in uint gaussian;                     // nearest last
uniform sampler2D gaussians;          // four texels each: centre and opacity, quaternion wxyz, scales, colour
uniform mat4 view;                    // world to camera: x right, y down, z forward
uniform vec2 focal, principal, size;  // pixels
uniform float near, eps2d, margin, minAlpha;

flat out vec3 conic;                  // inverse of the projected covariance: xx, xy, yy
flat out vec4 colour;                 // and opacity
out vec2 offset;                      // from the centre, pixels

vec4 texel(uint part) {
    uint place = gaussian * 4u + part;
    uint width = uint(textureSize(gaussians, 0).x);
    return texelFetch(gaussians, ivec2(place % width, place / width), 0);
}

mat3 rotation(vec4 q) {
    float w = q.x, x = q.y, y = q.z, z = q.w;
    return transpose(mat3(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)));
}

void main() {
    vec4 place = texel(0u);
    vec3 centre = (view * vec4(place.xyz, 1.0)).xyz;
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside, unless it is seen
    if (centre.z < near || place.w < minAlpha) return;

    vec2 ratio = centre.xy / centre.z;
    vec2 border = margin * 0.5 * size / focal;
    vec2 slope = clamp(ratio, -principal / focal - border, (size - principal) / focal + border);
    vec2 gain = focal / centre.z;
    mat3 axes = mat3(view) * rotation(normalize(texel(1u)));
    vec3 scales = texel(2u).xyz;
    // rows of J W R S: how far each principal axis reaches in the picture
    vec3 across = gain.x * (vec3(axes[0].x, axes[1].x, axes[2].x) - slope.x * vec3(axes[0].z, axes[1].z, axes[2].z)) * scales;
    vec3 down = gain.y * (vec3(axes[0].y, axes[1].y, axes[2].y) - slope.y * vec3(axes[0].z, axes[1].z, axes[2].z)) * scales;
    float xx = dot(across, across) + eps2d, xy = dot(across, down), yy = dot(down, down) + eps2d;
    vec3 normal = cross(across, down);
    float determinant = dot(normal, normal) + eps2d * (xx + yy - eps2d);

    conic = vec3(yy, -xy, xx) / determinant;
    colour = vec4(texel(3u).rgb, place.w);
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    offset = corner * sqrt(2.0 * log(place.w / minAlpha)) * sqrt(vec2(xx, yy));
    vec2 pixel = focal * ratio + principal + offset;
    gl_Position = vec4((pixel / size * 2.0 - 1.0) * vec2(1.0, -1.0), 0.0, 1.0);
}
