// <mary-avatar>: a talking head for any page, by this one line:
// <script type="module" src="https://…/static/mary.js"></script>

import { MaryAvatar } from "./avatar_element.js";

// The same file asked for by two addresses is two modules; the first one wins.
if (!customElements.get("mary-avatar")) customElements.define("mary-avatar", MaryAvatar);

export { MaryAvatar };
