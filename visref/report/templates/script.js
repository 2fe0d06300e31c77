"use strict";
(() => {
{% include "page.js" %}
{% include "frames.js" %}
{% include "crops.js" %}
{% if flight is not none %}
{% include "flight.js" %}
{% endif %}
{% include "list.js" %}
{% include "plots.js" %}
{% include "copying.js" %}
document.documentElement.classList.add("live");
addEventListener("hashchange", page.follow);
})();
