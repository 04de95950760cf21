// Names for the controls of viser that have none: a screen reader says the heading, the label and the value.
(() => {
  const name = (control, words) => {
    if (control.getAttribute('aria-label') !== words) control.setAttribute('aria-label', words);
  };
  const heading = label => {
    const paper = label.closest('.mantine-Paper-root');
    const first = paper && paper.firstElementChild;
    return first && !first.contains(label) ? first.textContent.trim() : '';
  };
  const run = () => {
    for (const label of document.querySelectorAll('label[for]')) {
      const row = label.closest('.mantine-Flex-root'), words = label.textContent.trim();
      if (!row || !words) continue;
      const above = heading(label), full = above ? above + ': ' + words : words;
      for (const control of row.querySelectorAll('[role=slider]')) name(control, full);
      for (const control of row.querySelectorAll('input:not([type=hidden]):not([type=checkbox]):not([role=combobox])'))
        name(control, row.querySelector('[role=slider]') ? full + ', as a number' : full);
    }
    for (const button of document.querySelectorAll('button')) {  // an icon alone
      const icon = button.querySelector('svg');
      if (button.textContent.trim() || button.title || !icon) continue;
      const kind = [...icon.classList].find(part => part.startsWith('tabler-icon-'));
      name(button, kind ? kind.slice('tabler-icon-'.length).replace(/-/g, ' ') : 'close');
    }
  };
  let waiting = false;
  new MutationObserver(() => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; run(); });
  }).observe(document, {childList: true, subtree: true, characterData: true});
})();
