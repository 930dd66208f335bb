/** A linked program of shaders, and the locations of its uniforms. */

export class Program {
  readonly #gl: WebGL2RenderingContext;
  readonly #program: WebGLProgram;
  readonly #uniforms = new Map<string, WebGLUniformLocation | null>();

  /** Throws the driver's message if a shader fails. */
  constructor(gl: WebGL2RenderingContext, vertex: string, fragment: string) {
    this.#gl = gl;
    this.#program = gl.createProgram();
    const shaders = [compiled(gl, gl.VERTEX_SHADER, vertex), compiled(gl, gl.FRAGMENT_SHADER, fragment)];
    for (const shader of shaders) {
      gl.attachShader(this.#program, shader);
    }
    gl.linkProgram(this.#program);
    // A lost context reports no success; the program is made anew with the context.
    if (!gl.getProgramParameter(this.#program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = [gl.getProgramInfoLog(this.#program), ...shaders.map((one) => gl.getShaderInfoLog(one))];
      throw new Error(`a shader cannot be used: ${logs.join(" ")}`);
    }
    for (const shader of shaders) {
      gl.deleteShader(shader);
    }
  }

  use(): void {
    this.#gl.useProgram(this.#program);
  }

  /** The location of a uniform; `null` if the shaders do not use it. */
  at(name: string): WebGLUniformLocation | null {
    let place = this.#uniforms.get(name);
    if (place === undefined) {
      place = this.#gl.getUniformLocation(this.#program, name);
      this.#uniforms.set(name, place);
    }
    return place;
  }

  delete(): void {
    this.#gl.deleteProgram(this.#program);
  }
}

function compiled(gl: WebGL2RenderingContext, kind: number, source: string): WebGLShader {
  const shader = gl.createShader(kind);
  if (shader === null) {
    throw new Error("the context was lost while shaders were compiled");
  }
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  return shader;
}
