/**
 * Messages between a page of Trimaran in a frame and the page around it, by `postMessage`: version 1.
 *
 * Only pages of the origins in `--frame-ancestors` can show Trimaran in a frame, and are heard. Requests are
 * answered one after the other, each by `done` or by `error` with its `id`.
 */

/** A direction or a place of the world: x, y up, z. Places in metres. */
export type Triple = readonly [number, number, number];

/**
 * A part of the model: by its exact name, or by the number of an object or of a group. Of several parts with
 * one name the first counts, groups before objects. Numbers are those of this scene's fingerprint alone.
 */
export type PartRef = { readonly name: string } | { readonly object: number } | { readonly group: number };

export interface Part {
  readonly kind: "object" | "group";
  readonly id: number;
  /** Empty if it has none. */
  readonly name: string;
}

export interface Pose {
  readonly eye: Triple;
  /** The viewing direction, of any length. */
  readonly forward: Triple;
  /** Vertical field of view: 20 to 100 degrees, or 0.0573 for a parallel view. */
  readonly vfovDeg: number;
}

interface Numbered {
  readonly trimaran: 1;
  /** A number, or a text of at most 100 letters. */
  readonly id: number | string;
}

/** A message to the page of Trimaran. */
export type Request = Numbered &
  (
    | { /** Answered by `ready` as well. */ readonly do: "hello" }
    | { readonly do: "goTo"; readonly part: PartRef }
    | {
        /** `select` without any part selects nothing. */
        readonly do: "select" | "isolate" | "hide";
        /** At most 100. */
        readonly parts: readonly PartRef[];
      }
    | { /** Nothing is hidden, isolated, see-through or cut any more. */ readonly do: "showAll" }
    | { /** As `viewChanged` has it. */ readonly do: "setView"; readonly view: string }
    | { readonly do: "setView"; readonly pose: Pose }
    | {
        readonly do: "takePicture";
        /** Pixels. By default those of the frame. */
        readonly size?: { readonly width: number; readonly height: number };
        readonly isCaptioned?: boolean;
      }
  );

/** A message from the page of Trimaran. */
export type Message = { readonly trimaran: 1 } & (
  | {
      /** Sent once the first picture is there. */
      readonly event: "ready";
      readonly scene: { readonly name: string; readonly fingerprint: string; readonly objects: number };
    }
  | {
      readonly event: "done";
      readonly id: number | string;
      /** The answer to `takePicture`: a PNG file. */
      readonly picture?: Blob;
    }
  | {
      readonly event: "error";
      /** The request that failed; without one, the link to the service has trouble. */
      readonly id?: number | string;
      readonly message: string;
    }
  | {
      readonly event: "selected";
      /** All that the person, or a request, has picked. */
      readonly parts: readonly Part[];
    }
  | {
      /** The eye rests at another place, or something was hidden, cut or measured. */
      readonly event: "viewChanged";
      readonly pose: Pose;
      /** The whole view, for `setView` in the same scene. It has no token. */
      readonly view: string;
    }
);
