"""Wordings that were written down before the names in other languages were, and by which no table was tuned: what people might type.

A wording that is not understood stays here. The list is a measure, not a list of wishes.
"""

#: For the classes of the phantom.
HELD_OUT = {
    "liver": [
        "liver", "a photo of a liver in the scene", "show me the liver please", "LIVER.", "the patient's liver", "livers", "lvier",
        "hepatic parenchyma", "liver, not gallbladder", "right lobe of the liver", "Leber", "zeig mir die Leber", "foie", "le foie",
        "hígado", "el hígado", "肝脏", "请显示肝脏", "liver surface", "where's the liver?",
    ],
    "gallbladder": [
        "gallbladder", "gall bladder", "the gallbladders", "gallbaldder", "gall-bladder wall", "cholecyst", "GB", "Gallenblase",
        "die Gallenblase", "vésicule biliaire", "la vesicule biliaire", "vesícula biliar", "胆囊", "an image of the gallbladder",
        "gallbladder without the liver", "segment the gall bladder",
    ],
    "fat": [
        "fat", "fatty tissue", "yellow fat", "adipose tissues", "the omentum", "Fett", "Fettgewebe", "graisse", "tissu adipeux", "grasa",
        "tejido graso", "脂肪", "脂肪组织", "visceral fat", "mesenteric fat",
    ],
    "abdominal wall": [
        "abdominal wall", "abdominal walls", "abdomial wall", "the wall of the abdomen", "Bauchwand", "paroi abdominale",
        "pared abdominal", "腹壁", "inner abdominal wall", "abdominalwall",
    ],
    "connective tissue": [
        "connective tissue", "conective tissue", "fascia", "Bindegewebe", "tissu conjonctif", "tejido conectivo", "结缔组织",
        "fibrous tissue", "connective tissues between liver and gallbladder",
    ],
    "grasper": [
        "grasper", "graspers", "graspper", "the grasping forceps", "laparoscopic grasper", "Fasszange", "Greifzange", "pince",
        "pince à préhension", "pinza", "pinza de agarre", "抓钳", "instrument, not the hook", "forceps", "tool but not electrocautery",
    ],
    "L-hook electrocautery": [
        "hook", "L hook", "l-hook", "electrocautery hook", "electrocautry", "cautery", "diathermy hook", "monopolar hook", "HF-Haken",
        "Elektrokauter", "crochet", "crochet de coagulation", "gancho", "electrocauterio", "电凝钩", "电钩", "bovie", "hooks",
    ],
    "charred tissue": [
        "charred tissue", "charring", "burnt tissue", "burned tissue", "cauterised tissue", "cauterized area", "carbonised tissue",
        "carbonized tissue", "black burnt spot", "verkohltes Gewebe", "tissu carbonisé", "tejido carbonizado", "烧焦组织",
        "coagulated tissue",
        "eschar", "thermal damage", "burn marks", "chared tissue",
    ],
    "background": ["background", "black background", "the black border", "Hintergrund", "arrière-plan", "fondo", "背景", "backgruond"],
}  # fmt: skip

#: Words and phrases of six languages that name nothing in this operation, many of them close to a name that is known.
FOREIGN = [
    "banana", "river", "lover", "delivery", "father", "cat", "hat", "falt", "ball game", "galaxy", "goblin", "book",
    "cook", "look", "hockey", "grape", "grass", "gasper", "chair", "chart", "church", "wallpaper", "wallet",
    "Wall Street", "background music", "a photo of a dog in the scene", "show me the keyboard", "Leder", "Lieber",
    "Gabel", "Apfel", "Feder", "Bauhaus", "Hacken", "foire", "voiture", "prince", "fromage", "perro", "pizza",
    "ventana", "grande", "熊猫", "汽车", "脂粉", "ピアノ", "собака", "connection", "collective", "tissue paper", "qwertz",
    "42", "the", "liverpool", "hooker", "electricity", "charity", "forecast", "fatal", "gaslight", "purple liver",
    "liver and onions", "not",
]  # fmt: skip
