#version 300 es
precision highp float;

uniform float minAlpha;
flat in vec3 conic;
flat in vec4 colour;
in vec2 offset;
out vec4 light;  // premultiplied

void main() {
    float exponent = 0.5 * (conic.x * offset.x * offset.x + conic.z * offset.y * offset.y) + conic.y * offset.x * offset.y;
    float alpha = min(0.999, colour.a * exp(-exponent));
    if (alpha < minAlpha) discard;
    light = vec4(colour.rgb * alpha, alpha);
}
