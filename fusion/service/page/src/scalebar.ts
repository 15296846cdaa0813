// A bar whose length in metres is a round number.
import { element } from "./dom";
import { metres } from "./format";

const LONGEST_PX = 140;

/** A bar of a picture with so many metres for each CSS pixel. */
export class ScaleBar {
  private readonly text = element("span");
  private readonly bar = element("div", { class: "bar" });
  readonly root = element("div", { class: "scale-bar" }, this.text, this.bar);

  set(metresPerPixel: number): void {
    const longest = LONGEST_PX * metresPerPixel;
    const power = 10 ** Math.floor(Math.log10(longest));
    const length = [5, 2, 1].map((each) => each * power).find((each) => each <= longest) ?? power;
    this.bar.style.width = `${length / metresPerPixel}px`;
    this.text.textContent = metres(length, 1);
  }
}
