"""Words for sides and parts of a body in the names of bones: in English, German, Spanish, French, Italian, Portuguese,
Russian, Chinese and Japanese.

They are lower case, without accents and spaces. Marks that mean something else in other rigs (D and G for right and
left in French, D and I in Spanish, E and D in Portuguese, dir) are left out.
"""

from __future__ import annotations

SIDES = {
    **dict.fromkeys(("l", "left", "lf", "lft", "lt", "links", "izq", "izquierda", "izquierdo", "gauche"), "L"),
    **dict.fromkeys(("sx", "sinistra", "sinistro", "esq", "esquerda", "esquerdo"), "L"),
    **dict.fromkeys(("л", "лев", "левая", "левое", "левый", "左"), "L"),
    **dict.fromkeys(("r", "right", "rt", "rgt", "rg", "rechts", "der", "derecha", "derecho", "droite", "droit"), "R"),
    **dict.fromkeys(("dx", "destra", "destro", "direita", "direito"), "R"),
    **dict.fromkeys(("п", "прав", "правая", "правое", "правый", "右"), "R"),
}
_PHALANX = r"(proximal|intermediate|distal)?\d*"

WORDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (
        "root",
        (r"root|master|reference|armature|wurzel", r"raiz|racine|radice|корень", r"全|全て"),
    ),
    (
        "hips",
        (
            r"hips?|pelvis|cog|bip\d*pelvis|lowertorso|lowerbody|becken|h(u|ue)fte",
            r"caderas?|bassin|hanches|bacino|quadril|таз",
            r"下半身|骨盆|臀部?",
        ),
    ),
    (
        "toe",
        (
            r"toes?(base)?\d*|ball|toebone|zehen?",
            r"(big|great|small|little|index|long|mid|middle|ring|pinky)toe\d*|foot(thumb|index|middle|ring|pinky)\d*",
            r"dedos?(del?)?pie|orteils?|(dita|alluce)(del)?piede|dedosdo?pe|пальцы(ног|ноги|стопы)?",
            r"つま先|脚趾",
        ),
    ),
    ("foot", (r"foot|feet|fu(ß|ss)", r"pie|pied|piede|pe|стопа|ступня", r"足首|脚掌?")),
    ("ankle", (r"ankle", r"tobillo|cheville|caviglia|tornozelo|лодыжка|щиколотка", r"脚踝|脚腕")),
    (
        "shin",
        (
            r"shin|calf|(lower|low|lwr|lo)leg|leglower|crus|tibia|fibula|unterschenkel",
            r"pantorrilla|espinilla|mollet|polpaccio|stinco|panturrilha|canela|голень",
            r"小腿",
        ),
    ),
    ("knee", (r"knee|knie", r"rodilla|genou|ginocchio|joelho|колено", r"ひざ|膝|膝盖")),
    ("leg", (r"leg|bein", r"pierna|jambe|gamba|perna|нога", r"腿")),
    (
        "thigh",
        (r"thigh|(upper|up|upr)leg|legupper|femur|oberschenkel", r"muslo|cuisse|coscia|coxa|бедро", r"足|大腿"),
    ),
    (
        "thumb",
        (
            rf"(hand|finger)?thumb(metacarpal|{_PHALANX})|daumen\d*",
            r"(pulgar|pouce|pollice|polegar|большойпалец)\d*",
            r"(親指|拇指)\d*",
        ),
    ),
    (
        "index",
        (
            rf"(hand|f|finger)?(index|pointer|fore)(finger)?{_PHALANX}|zeigefinger\d*",
            r"(indice|indicador|указательныйпалец)\d*",
            r"(人指|人差指|人差し指|食指)\d*",
        ),
    ),
    (
        "middle",
        (
            rf"(hand|f|finger)?(middle|mid)(finger)?{_PHALANX}|mittelfinger\d*",
            r"(medio|corazon|majeur|среднийпалец)\d*",
            r"中指\d*",
        ),
    ),
    (
        "ring",
        (
            rf"(hand|f|finger)?ring(finger)?{_PHALANX}",
            r"(anular|annulaire|anulare|anelar|безымянныйпалец)\d*",
            r"(薬指|无名指)\d*",
        ),
    ),
    (
        "pinky",
        (
            rf"(hand|f|finger)?(pinky|little|pinkie|small)(finger)?{_PHALANX}|kleine?finger\d*",
            r"(menique|auriculaire|mignolo|mindinho|minimo|мизинец)\d*",
            r"小指\d*",
        ),
    ),
    ("finger", (r"(finger|digit)\d+",)),
    ("hand", (r"hand|fist", r"mano|main|mao|кисть", r"手掌?")),
    ("wrist", (r"wrist|handgelenk", r"muneca|poignet|polso|pulso|запястье", r"手首|手腕")),
    ("palm", (r"palm",)),
    (
        "forearm",
        (
            r"forearm|radius|ulna|(lower|low|lwr|lo|f)arm|armlower|unterarm",
            r"antebrazo|avantbras|avambraccio|antebraco|предплечье",
            r"ひじ|肘|前臂|小臂",
        ),
    ),
    ("elbow", (r"elbow|ell(en)?bogen", r"codo|coude|gomito|cotovelo|локоть", r"手肘")),
    ("upper_arm", (r"(upper|up|upr|u)arm|armupper|humerus|shldr|oberarm", r"腕|上臂|大臂")),
    ("arm", (r"arm", r"brazo|bras|braccio|braco|рука")),
    ("shoulder", (r"shoulder|schulter", r"hombro|epaule|spalla|ombro|плечо", r"肩膀?")),
    (
        "collar",
        (
            r"clav(i|icle)?|collar(bone)?|scapula|schl(u|ue)sselbein",
            r"clavicul[ae]|clavicola|ключица",
            r"锁骨",
        ),
    ),
    ("head", (r"(neck)?head\d*|headneckupper|kopf", r"cabeza|tete|testa|cabeca|голова", r"頭|头")),
    (
        "neck",
        (r"neck(lower|upper)?\d*|headnecklower|hals|nacken", r"(cuello|cou|collo|pescoco|шея)\d*", r"首|颈|脖子"),
    ),
    (
        "spine",
        (
            r"(spine(middle)?|(upper|lower)?chest|(upper|lower)?torso|abdomen|abs?|stomach|waist|lowerback|back|ribcage|thorax"
            r"|trunk|belly|(upper)?body|wirbels(a|ae)ule|brust(korb)?|bauch|r(u|ue)cken|上半身)(lower|upper)?\d*",
            r"(columna|espalda|pecho|colonne|dos|ventre|poitrine|torse|buste|colonna|schiena|petto|busto|addome|coluna"
            r"|costas|peito|tronco|abdome|позвоночник|спина|поясница|грудь|живот|торс)\d*",
            r"脊椎\d*",
        ),
    ),
)
"""Parts of a body and patterns of their words, matched with names without namespace, side and function."""
