// The plate's guide in RGB, exposed and display-encoded as relight/subject.py does; the matte in alpha.
uniform sampler2D photograph;
uniform sampler2D matte;
uniform float exposure;
uniform float brightest;

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 exposed = clamp(texelFetch(photograph, pixel, 0).rgb * exposure, 0.0, 4.0);
  result = vec4(pow(exposed, vec3(1.0 / 2.2)) / brightest, texelFetch(matte, pixel, 0).r);
}
