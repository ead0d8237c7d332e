"""Build and install bev_mapper; its version stands in package.xml alone."""

from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

PACKAGE = 'bev_mapper'
MANIFEST = ET.parse('package.xml')

setup(
    name=PACKAGE,
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(),
    package_data={
        PACKAGE: [
            'py.typed',
            'segmentation/weights/*.safetensors',
            'segmentation/weights/*.json',
            'segmentation/weights/*.md',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
    ],
    zip_safe=False,
    entry_points={'console_scripts': ['bev_mapper_node = bev_mapper.node:main']},
)
