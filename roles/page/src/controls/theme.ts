/** The colours of panels: those that the system prefers, or light or dark ones. */

import { effect, signal } from "@preact/signals";

export const THEMES = ["system", "light", "dark"] as const;
export type Theme = (typeof THEMES)[number];

const STORED = "trimaran-theme";

/** This person's choice. */
export const theme = signal<Theme>(storedTheme());

export function chooseTheme(chosen: Theme): void {
  theme.value = chosen;
  try {
    localStorage.setItem(STORED, chosen);
  } catch {
    // Without storage the browser keeps it as long as the page is open.
  }
}

/** Sets `data-theme` of the document to `light` or `dark`, now and at each change. */
export function applyTheme(): void {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const prefersDark = signal(system.matches);
  system.addEventListener("change", ({ matches }) => {
    prefersDark.value = matches;
  });
  effect(() => {
    const preferred = prefersDark.value ? "dark" : "light";
    document.documentElement.dataset.theme = theme.value === "system" ? preferred : theme.value;
  });
}

function storedTheme(): Theme {
  try {
    const stored = localStorage.getItem(STORED);
    return THEMES.find((theme) => theme === stored) ?? "system";
  } catch {
    return "system";
  }
}
