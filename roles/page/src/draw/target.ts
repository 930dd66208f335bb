/** What is drawn into: a picture with a depth of 32 bits, or the numbers of drawables. */

export class Target {
  readonly #gl: WebGL2RenderingContext;
  readonly #what: "picture" | "items";
  readonly #samples: number;
  readonly #frame: WebGLFramebuffer;
  readonly #colour: WebGLRenderbuffer;
  readonly #depth: WebGLRenderbuffer;
  #width = 0;
  #height = 0;

  constructor(gl: WebGL2RenderingContext, what: "picture" | "items", samples: number) {
    [this.#gl, this.#what, this.#samples] = [gl, what, samples];
    this.#frame = gl.createFramebuffer();
    this.#colour = gl.createRenderbuffer();
    this.#depth = gl.createRenderbuffer();
  }

  /** Draws go here from now on. */
  begin(width: number, height: number): void {
    const gl = this.#gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#frame);
    if (width !== this.#width || height !== this.#height) {
      [this.#width, this.#height] = [width, height];
      const samples = this.#samples > 1 ? this.#samples : 0;
      for (const [buffer, format, place] of [
        [this.#colour, this.#what === "items" ? gl.R32UI : gl.RGBA8, gl.COLOR_ATTACHMENT0],
        [this.#depth, gl.DEPTH_COMPONENT32F, gl.DEPTH_ATTACHMENT],
      ] as const) {
        gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
        gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, width, height);
        gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
      }
    }
    gl.viewport(0, 0, width, height);
    if (this.#what === "items") {
      gl.clearBufferuiv(gl.COLOR, 0, [0xffff_ffff, 0, 0, 0]);
    }
  }

  /** Puts the picture onto the canvas. */
  show(): void {
    const gl = this.#gl;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.#frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    const size = [0, 0, this.#width, this.#height] as const;
    gl.blitFramebuffer(...size, ...size, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** The numbers, rows from below. */
  read(): Uint32Array {
    const gl = this.#gl;
    const numbers = new Uint32Array(this.#width * this.#height);
    gl.readPixels(0, 0, this.#width, this.#height, gl.RED_INTEGER, gl.UNSIGNED_INT, numbers);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return numbers;
  }
}
