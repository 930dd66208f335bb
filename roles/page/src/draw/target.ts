/** Render targets: colour or numbers, with a 32-bit depth buffer. */

/** The render target of a picture. */
export interface PictureTarget {
  /** Draws go here from now on. */
  begin(width: number, height: number): void;
  /** Puts the picture onto the canvas. */
  show(): void;
}

/** The canvas itself. It needs a suitable depth buffer: see `canvasDepth.ts`. */
export class CanvasTarget implements PictureTarget {
  readonly #gl: WebGL2RenderingContext;

  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
  }

  begin(width: number, height: number): void {
    this.#gl.bindFramebuffer(this.#gl.FRAMEBUFFER, null);
    this.#gl.viewport(0, 0, width, height);
  }

  /** Nothing to do. */
  show(): void {}
}

export class Target implements PictureTarget {
  readonly #gl: WebGL2RenderingContext;
  readonly #format: number;
  readonly #samples: number;
  readonly #frame: WebGLFramebuffer;
  readonly #colour: WebGLRenderbuffer;
  readonly #depth: WebGLRenderbuffer;
  #width = 0;
  #height = 0;

  /** `format` is a renderbuffer format. Only pictures have more than one sample a pixel. */
  constructor(gl: WebGL2RenderingContext, format: number, samples = 1) {
    [this.#gl, this.#format, this.#samples] = [gl, format, samples];
    this.#frame = gl.createFramebuffer();
    this.#colour = gl.createRenderbuffer();
    this.#depth = gl.createRenderbuffer();
  }

  /** The content stays until it is cleared, unless the size changes. */
  begin(width: number, height: number): void {
    const gl = this.#gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#frame);
    if (width !== this.#width || height !== this.#height) {
      [this.#width, this.#height] = [width, height];
      this.#attach(this.#colour, this.#format, gl.COLOR_ATTACHMENT0);
      this.#attach(this.#depth, gl.DEPTH_COMPONENT32F, gl.DEPTH_ATTACHMENT);
    }
    gl.viewport(0, 0, width, height);
  }

  #attach(buffer: WebGLRenderbuffer, format: number, place: number): void {
    const gl = this.#gl;
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    const samples = this.#samples > 1 ? this.#samples : 0;
    gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, this.#width, this.#height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
  }

  show(): void {
    const gl = this.#gl;
    const [width, height] = [this.#width, this.#height];
    gl.invalidateFramebuffer(gl.FRAMEBUFFER, DEPTH_ALONE);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Reads numbers, rows from below: for each pixel as many as `format` has. */
  read(format: number, into: Uint32Array): void {
    const gl = this.#gl;
    gl.readPixels(0, 0, this.#width, this.#height, format, gl.UNSIGNED_INT, into);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  delete(): void {
    this.#gl.deleteRenderbuffer(this.#colour);
    this.#gl.deleteRenderbuffer(this.#depth);
    this.#gl.deleteFramebuffer(this.#frame);
  }
}

/** gl.DEPTH_ATTACHMENT. */
const DEPTH_ALONE = [0x8d00];
