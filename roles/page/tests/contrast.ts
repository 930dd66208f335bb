/** The contrast of the page's texts, by its real styles. */

/** A text, and its contrast (WCAG 2.2) to the worst background that can be behind it. */
export interface Contrast {
  readonly text: string;
  readonly ratio: number;
}

/**
 * Runs in the page. Panels let a little of the model through, so each text is over black and over white:
 * whichever is worse counts.
 */
export function contrasts(): Contrast[] {
  type Colour = readonly [number, number, number, number];
  const read = (text: string): Colour => {
    const [red = 0, green = 0, blue = 0, alpha = 1] = (text.match(/[\d.]+/g) ?? []).map(Number);
    return text.startsWith("rgb") ? [red, green, blue, alpha] : [0, 0, 0, 0];
  };
  const over = ([red, green, blue, alpha]: Colour, behind: Colour): Colour => {
    const mix = (front: number, back: number) => alpha * front + (1 - alpha) * back;
    return [mix(red, behind[0]), mix(green, behind[1]), mix(blue, behind[2]), 1];
  };
  const luminance = ([red, green, blue]: Colour) => {
    const [r, g, b] = [red, green, blue].map((channel) => {
      const share = channel / 255;
      return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * (r ?? 0) + 0.7152 * (g ?? 0) + 0.0722 * (b ?? 0);
  };
  /** The backgrounds behind an element, from the front. */
  const layers = (element: Element): Colour[] => {
    const found: Colour[] = [];
    for (let at: Element | null = element; at !== null; at = at.parentElement) {
      // The model is behind all panels, and in front of the page's own background.
      if (at === document.body) {
        break;
      }
      found.push(read(getComputedStyle(at).backgroundColor));
    }
    return found;
  };
  const ratioOf = (colour: Colour, behind: readonly Colour[]): number => {
    const ratios = [0, 255].map((tone) => {
      const back = [...behind]
        .reverse()
        .reduce<Colour>((under, layer) => over(layer, under), [tone, tone, tone, 1]);
      const [a, b] = [luminance(over(colour, back)), luminance(back)];
      return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    });
    return Math.min(...ratios);
  };
  const found: Contrast[] = [];
  for (const element of document.querySelectorAll<HTMLElement | SVGElement>("#panels *")) {
    const own = [...element.childNodes].filter(({ nodeType }) => nodeType === Node.TEXT_NODE);
    const isField =
      element instanceof HTMLSelectElement ||
      (element instanceof HTMLInputElement && !["range", "checkbox", "file"].includes(element.type));
    const text = isField ? element.value : own.map(({ textContent }) => (textContent ?? "").trim()).join("");
    const style = getComputedStyle(element);
    const isShown = element.checkVisibility({ visibilityProperty: true });
    if (
      isShown &&
      element instanceof HTMLInputElement &&
      element.placeholder !== "" &&
      element.value === ""
    ) {
      const colour = read(getComputedStyle(element, "::placeholder").color);
      found.push({ text: element.placeholder, ratio: ratioOf(colour, layers(element)) });
    }
    if (!isShown || text === "" || element.tagName === "title") {
      continue;
    }
    if (element instanceof SVGElement) {
      // Over its outline, or over the face of the cube.
      const face = element.parentElement?.querySelector("polygon");
      const [red, green, blue] = read(face ? getComputedStyle(face).fill : style.stroke);
      const alpha = face ? Number(face.getAttribute("fill-opacity") ?? 1) : 1;
      found.push({ text, ratio: ratioOf(read(style.fill), [[red, green, blue, alpha]]) });
    } else {
      found.push({ text, ratio: ratioOf(read(style.color), layers(element)) });
    }
  }
  return found;
}
